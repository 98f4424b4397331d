//! Merges the partial pictures of all bricks.

use std::borrow::Borrow;

use super::partial::{Partial, named};
use super::plan::{Plan, of_another_plan};
use crate::error::{Error, Result};
use crate::image::Image;

/// Merges partial pictures in any order, owned or borrowed, into the picture of their plan.
///
/// # Errors
/// [`Error::Setting`] if a brick is missing or there twice, or a part belongs to another plan; [`Error::Memory`].
pub fn merge<P: Borrow<Partial>>(plan: &Plan, parts: impl IntoIterator<Item = P>) -> Result<Image> {
    let parts: Vec<P> = parts.into_iter().collect();
    let mut parts: Vec<&Partial> = parts.iter().map(Borrow::borrow).collect();
    parts.sort_by_key(|part| (part.bricks.start, part.bricks.end));
    let mut next = 0;
    for part in &parts {
        if part.plan != plan.id() {
            return Err(of_another_plan(part));
        }
        match part.bricks.start {
            start if start > next => {
                let reason = format!("{} missing", are(next..start));
                return Err(Error::setting("parts", reason));
            }
            start if start < next => {
                return Err(Error::setting("parts", format!("brick {start} is there twice, expected each brick once")));
            }
            _ => next = part.bricks.end,
        }
    }
    if next < plan.bricks().len() {
        let reason = format!("{} missing", are(next..plan.bricks().len()));
        return Err(Error::setting("parts", reason));
    }
    let mut parts = parts.into_iter();
    let first = parts.next().ok_or_else(|| Error::setting("parts", "there are none"))?;
    let Some(second) = parts.next() else { return plan.picture(first) };
    plan.picture(&parts.try_fold(first.over(second)?, |front, back| front.over(back))?)
}

/// Bricks as the subject of a sentence.
fn are(bricks: std::ops::Range<usize>) -> String {
    format!("{} {}", named(&bricks), if bricks.len() == 1 { "is" } else { "are" })
}
