//! SLC, the volumes of VolVis (Avila et al. 1994): a header of text with a picture, then planes of bytes, each of which
//! may be compressed by runs. VTK reads it with vtkSLCReader, and writes none.

use std::io::{self, BufRead, Read};

use super::LoadOptions;
use super::decode::{Layout, read_all};
use super::input::{Input, buffered};
use super::placement::Placement;
use super::selection::{Pick, chosen};
use crate::error::{Damage, Result, refuse, refuse_if};
use crate::volume::{Endian, Origin, SampleType, Units, Volume};

/// The first word of a file.
const MAGIC: &str = "11111";

/// The largest number of bytes that a byte of a run makes: two bytes make at most 127.
const MAX_EXPANSION: u64 = 64;

/// The names of the units of length, by their codes.
const LENGTHS: [&str; 4] = ["m", "mm", "µm", "ft"];

/// The modalities in the terms of DICOM, by the codes of the origin of values.
const MODALITIES: [Option<&str>; 3] = [Some("GM"), Some("MR"), Some("CT")];

/// Returns whether a file with these first bytes is an SLC file.
pub(super) fn is_slc(head: &[u8]) -> bool {
    head.strip_prefix(MAGIC.as_bytes()).and_then(<[u8]>::first).is_some_and(u8::is_ascii_whitespace)
}

/// Reads the volume of a file at the start of `input`.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let path = input.path().to_owned();
    let magic = word(&mut input)?;
    refuse_if!(magic != MAGIC, input, "begins with {magic:?}, expected {MAGIC}");
    let sizes: [i64; 3] = numbers(&mut input, "the size")?;
    let [bits] = numbers::<u32, 1>(&mut input, "the number of bits")?;
    refuse_if!(bits != 8, input, "has samples of {bits} bits, expected 8");
    let stated: [f64; 3] = numbers(&mut input, "the spacing")?;
    let [unit, origin, _, compression]: [usize; 4] = numbers(&mut input, "a code")?;
    refuse_if!(compression > 1, input, "has the compression {compression}, expected 0 or 1");
    let placement = Placement::axis_parallel(stated);
    let grid = placement.grid(&path, &sizes, options.spacing)?;
    // The picture: its width, its height and X, then red, green and blue, plane after plane.
    let picture: [u64; 2] = numbers(&mut input, "the size of the picture")?;
    let mark = word(&mut input)?;
    refuse_if!(mark != "X", input, "has {mark:?} behind the size of its picture, expected X");
    let bytes = picture[0].saturating_mul(picture[1]).saturating_mul(3);
    input.skip(bytes)?;
    if compression == 1 {
        let plane = u64::from(grid.dims()[0]) * u64::from(grid.dims()[1]);
        input.decompress(MAX_EXPANSION, |reader| buffered(SlcPlanes { reader, plane, samples: io::Cursor::default() }));
    }
    let samples = read_all(input, &Pick::all(grid.len()), SampleType::U8, Layout::Binary(Endian::NATIVE))?;
    let mut contents = chosen(&path, options, 1, 1)?;
    contents.origin = Origin::of(MODALITIES.get(origin).copied().flatten(), []);
    let units = Units { length: LENGTHS.get(unit).map(|unit| (*unit).to_owned()), value: None };
    Ok(placement.volume(grid, samples)?.with_units(units).with_contents(contents))
}

/// Reads the next numbers of a header, between blanks.
fn numbers<T: std::str::FromStr, const N: usize>(input: &mut Input, what: &str) -> Result<[T; N]> {
    let mut numbers = Vec::new();
    for _ in 0..N {
        let word = word(input)?;
        let Ok(number) = word.parse() else { refuse!(input, "its header has {word:?} as {what}") };
        numbers.push(number);
    }
    numbers.try_into().map_err(|_| input.error("has no header"))
}

/// The length of the longest word of a header.
const LONGEST_WORD: usize = 32;

/// Reads the next word of a header. `X` ends it without a blank: bytes follow.
fn word(input: &mut Input) -> Result<String> {
    let mut word = String::new();
    while word.len() < LONGEST_WORD {
        match char::from(input.bytes(1)?[0]) {
            c if c.is_ascii_whitespace() && word.is_empty() => {}
            c if c.is_ascii_whitespace() => break,
            c => word.push(c),
        }
        if word == "X" {
            break;
        }
    }
    Ok(word)
}

/// Planes that are compressed one by one: the number of their bytes, X, and runs. The first byte of a
/// run has its length, and in its highest bit whether a value for each sample follows, or one for all. A length of 0
/// ends a plane.
struct SlcPlanes {
    reader: Box<dyn BufRead>,
    /// The number of samples of a plane.
    plane: u64,
    /// The samples of the last plane.
    samples: io::Cursor<Vec<u8>>,
}

impl SlcPlanes {
    /// Decompresses the next plane, if there is one.
    fn advance(&mut self) -> io::Result<()> {
        let mut head = Vec::new();
        (&mut self.reader).take(LONGEST_WORD as u64).read_until(b'X', &mut head)?;
        let text = head.strip_suffix(b"X").map(|text| String::from_utf8_lossy(text).trim().parse::<u64>());
        let size = match text {
            Some(Ok(size)) => size,
            None if head.trim_ascii().is_empty() => return Ok(()),
            _ => refuse!(Damage, "a plane begins with no number of bytes"),
        };
        let (mut packed, mut samples) = (Vec::new(), Vec::new());
        (&mut self.reader).take(size).read_to_end(&mut packed)?;
        let mut rest = packed.as_slice();
        while let Some((&head, after)) = rest.split_first() {
            let length = usize::from(head & 0x7f);
            if length == 0 {
                break;
            }
            let used = if head & 0x80 == 0 { 1 } else { length };
            let Some((run, after)) = after.split_at_checked(used) else { break };
            samples.extend(run.iter().copied().cycle().take(length));
            rest = after;
        }
        if samples.len() as u64 != self.plane {
            refuse!(Damage, "a plane has {} samples, expected {}", samples.len(), self.plane);
        }
        self.samples = io::Cursor::new(samples);
        Ok(())
    }
}

impl Read for SlcPlanes {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.samples.position() == self.samples.get_ref().len() as u64 {
            self.advance()?;
        }
        self.samples.read(out)
    }
}
