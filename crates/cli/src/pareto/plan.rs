//! The order of the work of a study, the time that it is expected to take, and the part that a budget of time holds.

use std::mem::{Discriminant, discriminant};

use voxsplat::settings::Painter;

use super::study::Variant;

/// A piece of work on a variant, by its index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Task {
    /// Draws the views of a variant, compares them with the truth, and times them once: a row of the report.
    Row(usize),
    /// Times the views of a variant once more.
    Round(usize),
}

/// A kind of work whose pieces take about as long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WorkKind {
    /// Traces the truth of a model.
    Truth { post: bool },
    /// Prepares a scene, draws all views and compares them.
    Errors { painter: Discriminant<Painter>, post: bool },
    /// Times the views of a variant.
    Frames { variant: usize, painter: Discriminant<Painter>, post: bool },
}

impl WorkKind {
    /// Returns whether the time of another kind of work predicts the time of this kind, if no piece of this kind is
    /// done: `likeness` counts from the most similar kind on.
    fn is_like(self, other: Self, likeness: u32) -> bool {
        match (self, other) {
            _ if likeness == 0 => self == other,
            (Self::Truth { .. }, Self::Truth { .. }) => true,
            (Self::Errors { post: a, .. }, Self::Errors { post: b, .. }) => likeness > 1 || a == b,
            (Self::Frames { painter: a, post: b, .. }, Self::Frames { painter: c, post: d, .. }) => {
                likeness > 1 || (a, b) == (c, d)
            }
            _ => false,
        }
    }
}

/// The plan of a study: the work that is done, and the expected time of the rest.
#[derive(Debug)]
pub(crate) struct Plan {
    /// Whether each variant is post-shaded, its painter, and the index of the first variant of its model.
    variants: Vec<(bool, Discriminant<Painter>, usize)>,
    /// The seconds for all work; `None` without a limit.
    budget: Option<f64>,
    /// The seconds of each piece of work that is done.
    done: Vec<(WorkKind, f64)>,
    /// The models whose truth is traced, by the index of their first variant.
    traced: Vec<usize>,
}

impl Plan {
    /// Makes a plan for variants. A budget of 0 seconds is no limit.
    pub(crate) fn new(variants: &[Variant], budget: f64) -> Self {
        let of = |variant: &Variant| {
            let first = variants.iter().position(|other| other.model == variant.model).unwrap_or_default();
            (variant.settings.is_post_shaded(), discriminant(&variant.settings.painter), first)
        };
        let budget = Some(budget).filter(|budget| *budget > 0.0);
        Self { variants: variants.iter().map(of).collect(), budget, done: Vec::new(), traced: Vec::new() }
    }

    /// Returns tasks in their order: rows, the most telling ones first, then further rounds of timing, in which a busy
    /// moment of the machine does not meet one variant alone. `open` has for each variant whether its row is open, and
    /// the number of rounds.
    pub(crate) fn tasks(telling: &[usize], open: &[(bool, u32)]) -> Vec<Task> {
        let rows = telling.iter().copied().filter(|&variant| open[variant].0).map(Task::Row);
        let most = open.iter().map(|(_, rounds)| *rounds).max().unwrap_or_default();
        let of_round = |round| (0..open.len()).filter(move |&variant| open[variant].1 > round).map(Task::Round);
        rows.chain((0..most).flat_map(of_round)).collect()
    }

    /// Returns the kind of work that traces the truth of a variant.
    pub(crate) fn truth(&self, variant: usize) -> WorkKind {
        WorkKind::Truth { post: self.variants[variant].0 }
    }

    /// Returns the kind of work that measures the errors of a variant.
    pub(crate) fn errors(&self, variant: usize) -> WorkKind {
        let (post, painter, _) = self.variants[variant];
        WorkKind::Errors { painter, post }
    }

    /// Returns the kind of work that times a variant.
    pub(crate) fn frames(&self, variant: usize) -> WorkKind {
        let (post, painter, _) = self.variants[variant];
        WorkKind::Frames { variant, painter, post }
    }

    /// Notes that a piece of work took some seconds.
    pub(crate) fn took(&mut self, kind: WorkKind, seconds: f64) {
        self.done.push((kind, seconds));
    }

    /// Notes that the truth of a variant's model is there.
    pub(crate) fn has_truth(&mut self, variant: usize) {
        self.traced.push(self.variants[variant].2);
    }

    /// Returns the seconds that a piece of work is expected to take: the mean of its kind, or else of similar kinds;
    /// `None` before the first.
    fn expected(&self, kind: WorkKind) -> Option<f64> {
        (0..3).find_map(|likeness| {
            let alike: Vec<f64> =
                self.done.iter().filter(|(of, _)| kind.is_like(*of, likeness)).map(|(_, seconds)| *seconds).collect();
            (!alike.is_empty()).then(|| alike.iter().sum::<f64>() / alike.len() as f64)
        })
    }

    /// Returns the seconds that tasks are expected to take.
    pub(crate) fn seconds(&self, tasks: &[Task]) -> f64 {
        let mut traced = self.traced.clone();
        let mut kinds = Vec::new();
        for task in tasks {
            if let Task::Row(variant) = *task {
                let model = self.variants[variant].2;
                if !traced.contains(&model) {
                    traced.push(model);
                    kinds.push(self.truth(variant));
                }
                kinds.push(self.errors(variant));
            }
            let (Task::Row(variant) | Task::Round(variant)) = *task;
            kinds.push(self.frames(variant));
        }
        kinds.into_iter().filter_map(|kind| self.expected(kind)).sum()
    }

    /// Returns whether the budget is used up, `elapsed` seconds after the start.
    pub(crate) fn is_over(&self, elapsed: f64) -> bool {
        self.budget.is_some_and(|budget| elapsed >= budget)
    }

    /// Returns whether a task is expected to end within the budget, `elapsed` seconds after the start.
    pub(crate) fn fits(&self, task: Task, elapsed: f64) -> bool {
        self.budget.is_none_or(|budget| elapsed + self.seconds(&[task]) < budget)
    }

    /// Returns the seconds that are left, `elapsed` seconds after the start: of the tasks, and at most of the budget;
    /// `None` before any work is done.
    pub(crate) fn left(&self, tasks: &[Task], elapsed: f64) -> Option<f64> {
        let rest = self.budget.map_or(f64::INFINITY, |budget| (budget - elapsed).max(0.0));
        (!self.done.is_empty()).then(|| self.seconds(tasks).min(rest))
    }
}

#[cfg(test)]
mod tests {
    use voxsplat::settings::Settings;

    use super::super::study::{telling, variants};
    use super::*;

    fn plan(budget: f64) -> (Plan, Vec<Variant>) {
        let variants = variants(&Settings::default());
        (Plan::new(&variants, budget), variants)
    }

    #[test]
    fn the_time_left_is_the_sum_of_each_kind_of_work() {
        let (mut plan, variants) = plan(0.0);
        let order = telling(&variants);
        let tasks = Plan::tasks(&order, &vec![(true, 2); variants.len()]);
        assert_eq!(tasks.len(), 3 * variants.len());
        assert_eq!(plan.seconds(&tasks), 0.0, "nothing is known");
        // Every truth takes 7 s, errors take 2 s post-shaded and otherwise 1 s, frames 0.5 s by tiles and 0.25 s.
        plan.took(plan.truth(0), 7.0);
        plan.has_truth(0);
        for (at, variant) in variants.iter().enumerate() {
            let post = variant.settings.is_post_shaded();
            let tiles = matches!(variant.settings.painter, Painter::Tiles);
            plan.took(plan.errors(at), if post { 2.0 } else { 1.0 });
            plan.took(plan.frames(at), if tiles { 0.5 } else { 0.25 });
        }
        let sum = |of: &dyn Fn(&Variant) -> f64| variants.iter().map(of).sum::<f64>();
        let errors = sum(&|v| if v.settings.is_post_shaded() { 2.0 } else { 1.0 });
        let frames = sum(&|v| if matches!(v.settings.painter, Painter::Tiles) { 0.5 } else { 0.25 });
        // Three of four models are left.
        assert!((plan.seconds(&tasks) - (21.0 + errors + 3.0 * frames)).abs() < 1e-9);
        let rounds = plan.left(&tasks[variants.len()..], 1e9).unwrap();
        assert!((rounds - 2.0 * frames).abs() < 1e-9, "{rounds}");
    }

    #[test]
    fn unknown_kinds_take_as_long_as_similar_ones() {
        let (mut plan, variants) = plan(0.0);
        let find = |post: bool, tiles: bool| {
            let is = |v: &Variant| {
                let of_painter = if tiles {
                    matches!(v.settings.painter, Painter::Tiles)
                } else {
                    matches!(v.settings.painter, Painter::Quads(_))
                };
                v.settings.is_post_shaded() == post && of_painter
            };
            variants.iter().position(is).unwrap()
        };
        plan.took(plan.frames(find(false, true)), 1.0);
        plan.took(plan.frames(find(false, false)), 3.0);
        assert_eq!(plan.seconds(&[Task::Round(find(false, false))]), 3.0);
        assert_eq!(plan.seconds(&[Task::Round(find(false, false) + 1)]), 3.0, "the same painter");
        assert_eq!(plan.seconds(&[Task::Round(find(true, false))]), 2.0, "all");
    }

    #[test]
    fn a_budget_holds_the_tasks_that_are_expected_to_end_in_it() {
        let (mut plan, _) = plan(10.0);
        assert!(plan.is_over(10.0) && !plan.is_over(9.9));
        assert!(plan.fits(Task::Row(0), 9.9) && !plan.fits(Task::Row(0), 10.0));
        assert_eq!(plan.left(&[Task::Row(0)], 1.0), None, "nothing is known");
        plan.took(plan.frames(0), 3.0);
        plan.took(plan.frames(1), 0.5);
        assert!(plan.fits(Task::Round(0), 6.9) && !plan.fits(Task::Round(0), 7.1));
        assert!(plan.fits(Task::Round(1), 7.1), "a shorter task still fits");
        let tasks = [Task::Round(0), Task::Round(1)];
        assert_eq!([1.0, 8.0, 12.0].map(|elapsed| plan.left(&tasks, elapsed)), [Some(3.5), Some(2.0), Some(0.0)]);
        let unlimited = self::plan(0.0).0;
        assert!(unlimited.fits(Task::Row(0), 1e9) && !unlimited.is_over(1e9));
    }

    #[test]
    fn open_rows_come_before_rounds_and_rounds_take_turns() {
        let open = [(true, 1), (false, 2), (true, 0), (false, 0)];
        let tasks = [Task::Row(2), Task::Row(0), Task::Round(0), Task::Round(1), Task::Round(1)];
        assert_eq!(Plan::tasks(&[2, 3, 1, 0], &open), tasks);
    }
}
