//! One volume of a file that holds several: a channel at a point in time.

use std::path::Path;

use super::LoadOptions;
use crate::error::{Error, Hint, Result, Subject, refuse};
use crate::names::listed;
use crate::volume::{Channel, Contents};

/// The role of an axis of samples in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Space,
    Channel,
    Time,
}

/// The axes of the samples of a file with their sizes, the fastest first.
pub(super) type Axes = Vec<(Role, i64)>;

/// The samples of a file that a volume has: runs of `run` samples, `step` samples apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pick {
    first: u64,
    pub(super) step: u64,
    pub(super) run: u64,
    /// The number of runs along each slower axis, and the number of samples from one run to the next; fastest first.
    beyond: Vec<[u64; 2]>,
    /// The number of all samples of the file.
    pub(super) all: u64,
}

impl Pick {
    /// Picks all of `count` samples.
    pub(super) fn all(count: u64) -> Self {
        Self { first: 0, step: 1, run: count, beyond: Vec::new(), all: count }
    }

    /// Picks the samples at the chosen indices of some axes and at all indices of the others; the fastest axis is the
    /// first.
    fn of(axes: &[(u64, Option<u64>)]) -> Option<Self> {
        // No number below exceeds the number of all samples.
        let all = axes.iter().try_fold(1_u64, |all, (size, _)| all.checked_mul(*size))?;
        let mut pick = Self { all: 1, ..Self::all(1) };
        for &(size, index) in axes {
            let stride = pick.all;
            match index {
                Some(index) => pick.first += index * stride,
                None if size == 1 => {}
                None if pick.run == 1 => (pick.step, pick.run) = (stride, size),
                None if pick.beyond.is_empty() && stride == pick.step * pick.run => pick.run *= size,
                None => pick.beyond.push([size, stride]),
            }
            pick.all = stride * size;
        }
        debug_assert_eq!(pick.all, all, "the product of the sizes");
        Some(pick)
    }

    /// Returns the number of picked samples.
    pub(super) fn len(&self) -> u64 {
        self.run * self.runs()
    }

    pub(super) fn runs(&self) -> u64 {
        self.beyond.iter().map(|[size, _]| size).product()
    }

    /// Returns the place in the file of the first sample of a run.
    pub(super) fn start(&self, mut run: u64) -> u64 {
        let mut start = self.first;
        for [size, stride] in &self.beyond {
            start += run % size * stride;
            run /= size;
        }
        start
    }

    /// Returns the place in the file of a picked sample.
    pub(super) fn place(&self, sample: u64) -> u64 {
        self.start(sample / self.run) + sample % self.run * self.step
    }

    /// Returns the place in the file behind the last picked sample.
    pub(super) fn end(&self) -> u64 {
        self.start(self.runs().saturating_sub(1)) + (self.run - 1) * self.step + 1
    }

    /// Returns the place of the first picked sample, if the others follow it without gaps.
    pub(super) fn in_one_piece(&self) -> Option<u64> {
        (self.step == 1 && self.beyond.is_empty()).then_some(self.first)
    }
}

/// Returns the channel and the point in time that the options request. The default is the first point in time; of
/// several channels one must be chosen.
pub(super) fn chosen(path: &Path, options: &LoadOptions, channels: u64, times: u64) -> Result<Contents> {
    let number = |name: &str, found: u64| match u32::try_from(found) {
        Ok(found) if found > 0 => Ok(found),
        _ => refuse!(path, "has {found} {name}"),
    };
    let (channels, times) = (number("channels", channels)?, number("points in time", times)?);
    let index = |name: &'static str, what: &str, asked: u32, found: u32| {
        if asked < found {
            return Ok(asked);
        }
        let range = if found == 1 { "0 alone".to_owned() } else { format!("0 to {}", found - 1) };
        Err(Error::Setting { name, reason: format!("{asked}, but {} has {what} {range}", path.display()) })
    };
    let time = index("time", "point in time", options.time.unwrap_or(0), times)?;
    if options.channel.is_none() && channels > 1 {
        return Err(path.error(format!("has {channels} channels per sample")).hinted(Hint::ChooseChannel));
    }
    let channel = index("channel", "channel", options.channel.unwrap_or(0), channels)?;
    Ok(Contents { time, times, channel, channels, ..Contents::default() })
}

/// Picks the samples of a volume in a file with these axes, the fastest first, and describes the content of the file.
pub(super) fn picked(path: &Path, axes: &[(Role, i64)], options: &LoadOptions) -> Result<(Pick, Contents)> {
    let (indices, contents) = indices(path, axes, options)?;
    let size = |(_, size): &(Role, i64)| u64::try_from(*size).unwrap_or(0).max(1);
    let indexed: Vec<(u64, Option<u64>)> = axes.iter().map(size).zip(indices).collect();
    let pick = Pick::of(&indexed).ok_or_else(|| path.error("claims more samples than any file has"))?;
    Ok((pick, contents))
}

/// Returns the index of the chosen channel and point in time along each of these axes, the fastest first, and the
/// content of the file; `None` for axes of space. Several axes of one role count as one.
pub(super) fn indices(
    path: &Path,
    axes: &[(Role, i64)],
    options: &LoadOptions,
) -> Result<(Vec<Option<u64>>, Contents)> {
    let size = |size: i64| u64::try_from(size).unwrap_or(0);
    let count =
        |role: Role| axes.iter().filter(|axis| axis.0 == role).map(|axis| size(axis.1)).fold(1, u64::saturating_mul);
    let contents = chosen(path, options, count(Role::Channel), count(Role::Time))?;
    let (mut channel, mut time) = (u64::from(contents.channel), u64::from(contents.time));
    let index = |axis: &(Role, i64)| {
        let number = match axis.0 {
            Role::Space => return None,
            Role::Channel => &mut channel,
            Role::Time => &mut time,
        };
        let index = *number % size(axis.1);
        *number /= size(axis.1);
        Some(index)
    };
    Ok((axes.iter().map(index).collect(), contents))
}

/// The largest number of series that a message lists.
const MOST_LISTED: usize = 20;

/// Returns the requested series, counted from 1, or the only one. The error about several series lists them in `words`.
pub(super) fn one_of<T>(path: &Path, series: Option<u32>, all: Vec<T>, words: impl Fn(&T) -> String) -> Result<T> {
    let count = all.len();
    if series.is_none() && count > 1 {
        let line = |(n, series): (usize, &T)| format!("{} is {}", n + 1, words(series));
        let listed: Vec<String> = all.iter().enumerate().take(MOST_LISTED).map(line).collect();
        let others = count - listed.len();
        let others = if others > 0 { format!(", and {others} others") } else { String::new() };
        let reason = format!("holds {count} series: {}{others}", listed.join(", "));
        return Err(path.error(reason).hinted(Hint::ChooseSeries));
    }
    let number = series.unwrap_or(1);
    let index = number.checked_sub(1).and_then(|index| usize::try_from(index).ok());
    index.and_then(|index| all.into_iter().nth(index)).ok_or_else(|| {
        let range = if count == 1 { "1 alone".to_owned() } else { format!("1 to {count}") };
        Error::setting("series", format!("{number}, but {} has series {range}", path.display()))
    })
}

/// Guesses the roles of four axes of unknown meaning, the fastest first: channels if the fastest has at most four
/// samples and all others more, else points in time along the slowest. Of five axes the two slowest are channels and
/// time.
pub(super) fn guessed(sizes: &[i64]) -> Axes {
    let few = 2..=4;
    let roles: &[Role] = match sizes {
        [c, others @ ..] if sizes.len() == 4 && few.contains(c) && others.iter().all(|size| size > few.end()) => {
            &[Role::Channel, Role::Space, Role::Space, Role::Space]
        }
        [_, _, _, _] => &[Role::Space, Role::Space, Role::Space, Role::Time],
        [_, _, _, _, _] => &[Role::Space, Role::Space, Role::Space, Role::Channel, Role::Time],
        _ => &[],
    };
    let role = |axis: usize| roles.get(axis).copied().unwrap_or(Role::Space);
    sizes.iter().enumerate().map(|(axis, &size)| (role(axis), size)).collect()
}

/// Guesses the roles of axes of unknown meaning, of which x is the first: channels if the last has at most four samples
/// and all others more, else points in time along the fourth axis, and channels along the fifth.
pub(super) fn guessed_xyz(sizes: &[i64]) -> Axes {
    let few = 2..=4;
    let is_short = |c: &i64, others: &[i64]| few.contains(c) && others.iter().all(|size| size > few.end());
    let beyond: &[Role] = match sizes {
        [others @ .., c] if sizes.len() == 4 && is_short(c, others) => &[Role::Channel],
        [_, _, _, _] => &[Role::Time],
        [_, _, _, _, _] => &[Role::Time, Role::Channel],
        _ => &[],
    };
    let role = |axis: usize| axis.checked_sub(3).and_then(|n| beyond.get(n)).copied().unwrap_or(Role::Space);
    sizes.iter().enumerate().map(|(axis, &size)| (role(axis), size)).collect()
}

/// Returns the labels of channels that are colours: red, green and blue, and opacity if there are four.
pub(super) fn colours(channels: u32) -> Vec<Channel> {
    let names = [("red", [255, 0, 0]), ("green", [0, 255, 0]), ("blue", [0, 0, 255]), ("alpha", [255; 3])];
    let label =
        |(name, color): &(&str, [u8; 3])| Channel { name: Some((*name).to_owned()), color: Some(*color), window: None };
    names.get(..channels as usize).unwrap_or_default().iter().map(label).collect()
}

/// Returns the labels of channels of bytes, which are colours by the custom of VTK and ITK if there are three or four.
pub(super) fn colours_of_bytes(channels: u32) -> Vec<Channel> {
    if channels == 3 || channels == 4 { colours(channels) } else { Vec::new() }
}

/// Returns the choice that a text of metadata names. The first choice is the default.
pub(super) fn choice<T: Copy, const N: usize>(
    file: &Path,
    name: &str,
    text: Option<&str>,
    choices: [(&str, T); N],
) -> Result<T> {
    let text = text.unwrap_or(choices[0].0);
    match choices.iter().find(|(choice, _)| *choice == text) {
        Some((_, choice)) => Ok(*choice),
        None => refuse!(file, "{name} is {text:?}, expected {}", listed(&choices.map(|(choice, _)| choice))),
    }
}

/// Returns a size of an axis as i64; the largest i64 if it is larger.
pub(super) fn sized(size: u64) -> i64 {
    i64::try_from(size).unwrap_or(i64::MAX)
}

/// Returns the sizes of the axes of space.
pub(super) fn spatial(axes: &[(Role, i64)]) -> Vec<i64> {
    axes.iter().filter(|(role, _)| *role == Role::Space).map(|(_, size)| *size).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picks_are_those_of_nested_loops() {
        use Role::{Channel as C, Space as S, Time as T};
        let cases: [&[(Role, i64)]; 7] = [
            &[(S, 3), (S, 4), (S, 5)],
            &[(C, 2), (S, 3), (S, 4), (S, 5)],
            &[(S, 3), (S, 4), (C, 2), (S, 5), (T, 3)],
            &[(T, 3), (S, 1), (S, 4), (C, 2), (S, 5)],
            &[(S, 3), (C, 2), (S, 4), (T, 3), (S, 5)],
            &[(S, 1), (S, 1), (S, 1), (C, 3)],
            &[(C, 2), (T, 2), (S, 3), (C, 3), (S, 4), (S, 1)],
        ];
        for axes in cases {
            let of = |role| axes.iter().filter(|a| a.0 == role).map(|a| a.1).product::<i64>();
            for (channel, time) in (0..of(C)).flat_map(|c| (0..of(T)).map(move |t| (c, t))) {
                let options =
                    LoadOptions { channel: Some(channel as u32), time: Some(time as u32), ..LoadOptions::default() };
                let (pick, contents) = picked(Path::new("a"), axes, &options).unwrap();
                let all: i64 = axes.iter().map(|a| a.1).product();
                let expected: Vec<u64> = (0..all)
                    .filter(|place| {
                        let (mut rest, mut indices) = (*place, [(0, 1); 2]);
                        for &(role, size) in axes {
                            let digit = rest % size;
                            rest /= size;
                            let slot = match role {
                                S => continue,
                                C => 0,
                                T => 1,
                            };
                            let (index, stride) = &mut indices[slot];
                            *index += digit * *stride;
                            *stride *= size;
                        }
                        (indices[0].0, indices[1].0) == (channel, time)
                    })
                    .map(|place| place as u64)
                    .collect();
                let found: Vec<u64> = (0..pick.runs())
                    .flat_map(|run| (0..pick.run).map(move |n| (run, n)))
                    .map(|(run, n)| pick.start(run) + n * pick.step)
                    .collect();
                assert_eq!(found, expected, "{axes:?}");
                assert_eq!(
                    (pick.len(), pick.end(), pick.all),
                    (found.len() as u64, found[found.len() - 1] + 1, all as u64)
                );
                assert_eq!((contents.channels, contents.times), (of(C) as u32, of(T) as u32));
            }
        }
    }

    #[test]
    fn a_choice_must_be_there() {
        let chosen = |channel, time, channels, times| {
            let options = LoadOptions { channel, time, ..LoadOptions::default() };
            chosen(Path::new("a.nrrd"), &options, channels, times).map_err(|error| format!("{error:#}"))
        };
        let taken = chosen(None, None, 1, 7).unwrap();
        assert_eq!((taken.channel, taken.time, taken.channels, taken.times), (0, 0, 1, 7));
        let refused = |result: Result<Contents, String>, words: &str| {
            let error = result.unwrap_err();
            assert!(error.contains(words), "{error}");
        };
        refused(chosen(None, None, 3, 1), "a.nrrd: has 3 channels per sample: set LoadOptions::channel");
        refused(chosen(Some(3), None, 3, 1), "channel: 3, but a.nrrd has channel 0 to 2");
        refused(chosen(None, Some(1), 1, 1), "time: 1, but a.nrrd has point in time 0 alone");
        refused(chosen(None, None, 0, 1), "has 0 channels");
        refused(chosen(None, None, 1, u64::MAX), "points in time");
    }

    #[test]
    fn axes_without_names_are_guessed() {
        let roles = |sizes: &[i64]| guessed(sizes).into_iter().map(|(role, _)| role).collect::<Vec<_>>();
        use Role::{Channel as C, Space as S, Time as T};
        assert_eq!(roles(&[3, 30, 40, 50]), [C, S, S, S]);
        assert_eq!(roles(&[3, 4, 40, 50]), [S, S, S, T]);
        assert_eq!(roles(&[30, 40, 50, 2]), [S, S, S, T]);
        assert_eq!(roles(&[30, 40, 50, 2, 6]), [S, S, S, C, T]);
        assert_eq!(roles(&[30, 40]), [S, S]);
        let roles = |sizes: &[i64]| guessed_xyz(sizes).into_iter().map(|(role, _)| role).collect::<Vec<_>>();
        assert_eq!(roles(&[30, 40, 50]), [S, S, S]);
        assert_eq!(roles(&[30, 40, 50, 3]), [S, S, S, C]);
        assert_eq!(roles(&[30, 40, 4, 3]), [S, S, S, T]);
        assert_eq!(roles(&[3, 40, 50, 60]), [S, S, S, T]);
        assert_eq!(roles(&[30, 40, 50, 6, 2]), [S, S, S, T, C]);
    }
}
