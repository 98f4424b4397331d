//! A picture in the terminal.

use std::io::{IsTerminal, stdout};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use voxsplat::image::{Background, Image};

use super::{Failure, output};

/// How a terminal shows pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Preview {
    /// What the terminal says that it knows, otherwise blocks.
    Auto,
    /// Half blocks in 24-bit colours: two pixels a character.
    Blocks,
    /// The graphics protocol of kitty, which ghostty and WezTerm know too
    /// (<https://sw.kovidgoyal.net/kitty/graphics-protocol>).
    Kitty,
    /// The inline images of iTerm2 (<https://iterm2.com/documentation-images.html>).
    Iterm,
}

/// The most columns that a picture takes, and what a terminal of unknown size has.
const MOST_COLUMNS: usize = 100;
const COMMON_SIZE: [usize; 2] = [80, 24];
/// The most characters of a piece of a picture, by kitty's protocol.
const PIECE: usize = 4096;

impl Preview {
    /// The protocol that is meant, if standard output takes it.
    pub(super) fn resolved(self) -> Result<Self, Failure> {
        if self != Self::Auto {
            return Ok(self);
        }
        if !stdout().is_terminal() {
            let reason = "--preview: standard output is no terminal, expected --preview blocks, kitty or iterm";
            return Err(Failure::Usage(reason.to_owned()));
        }
        let is = |name: &str, value: &str| std::env::var(name).is_ok_and(|v| v.eq_ignore_ascii_case(value));
        let kitty = std::env::var_os("KITTY_WINDOW_ID").is_some() || is("TERM", "xterm-kitty");
        Ok(match () {
            () if kitty || is("TERM_PROGRAM", "ghostty") || is("TERM_PROGRAM", "WezTerm") => Self::Kitty,
            () if is("TERM_PROGRAM", "iTerm.app") || is("TERM_PROGRAM", "mintty") => Self::Iterm,
            () => Self::Blocks,
        })
    }

    /// Prints a picture. What is clear is over black.
    pub(super) fn show(self, image: &Image, background: Background) -> Result<(), Failure> {
        let size = terminal_size::terminal_size().map(|(width, height)| [width.0.into(), height.0.into()]);
        let [columns, rows] = size.unwrap_or(COMMON_SIZE);
        let [width, height] = [image.width(), image.height()].map(|side| side as usize);
        // A character is about twice as high as it is wide; a row stays for the prompt.
        let high = 2 * rows.saturating_sub(1).max(1);
        let columns = columns.min(MOST_COLUMNS).min((high * width).div_ceil(height)).max(1);
        match self {
            Self::Kitty => output::print_bytes(kitty(&image.to_png(background)?, columns).as_bytes()),
            Self::Iterm => output::print_bytes(iterm(&image.to_png(background)?, columns).as_bytes()),
            Self::Auto | Self::Blocks => {
                let rgba = image.to_rgba8(if background == Background::Transparent {
                    Background::default()
                } else {
                    background
                });
                output::print_bytes(blocks(&rgba, [width, height], columns).as_bytes())
            }
        }
    }
}

/// A PNG by kitty's protocol, so many columns wide.
fn kitty(png: &[u8], columns: usize) -> String {
    let text = STANDARD.encode(png);
    let count = text.len().div_ceil(PIECE);
    let mut all = String::with_capacity(text.len() + 32 * count);
    for (number, piece) in text.as_bytes().chunks(PIECE).enumerate() {
        let more = u8::from(number + 1 < count);
        let head = if number == 0 { format!("a=T,f=100,c={columns},m={more}") } else { format!("m={more}") };
        // Base64 is ASCII.
        all += &format!("\x1b_G{head};{}\x1b\\", String::from_utf8_lossy(piece));
    }
    all + "\n"
}

/// A PNG as an inline image of iTerm2, so many columns wide.
fn iterm(png: &[u8], columns: usize) -> String {
    let head = format!("inline=1;width={columns};preserveAspectRatio=1;size={}", png.len());
    format!("\x1b]1337;File={head}:{}\x07\n", STANDARD.encode(png))
}

/// Half blocks of the means of pixels, so many columns wide.
fn blocks(rgba: &[u8], [width, height]: [usize; 2], columns: usize) -> String {
    let columns = columns.min(width);
    // Whole characters: two pixels each.
    let rows = (columns * height).div_ceil(width).next_multiple_of(2);
    let mean = |column: usize, row: usize| -> [usize; 3] {
        let range = |i: usize, of: usize, pixels: usize| {
            let from = (i * pixels / of).min(pixels - 1);
            from..((i + 1) * pixels / of).clamp(from + 1, pixels)
        };
        let (xs, ys) = (range(column, columns, width), range(row, rows, height));
        let count = xs.len() * ys.len();
        let mut sums = [0; 3];
        for at in ys.flat_map(|y| xs.clone().map(move |x| 4 * (x + width * y))) {
            sums.iter_mut().zip(&rgba[at..]).for_each(|(sum, &c)| *sum += usize::from(c));
        }
        sums.map(|sum| sum / count)
    };
    let mut all = String::new();
    for row in (0..rows).step_by(2) {
        for column in 0..columns {
            let ([r, g, b], [s, t, u]) = (mean(column, row), mean(column, row + 1));
            all += &format!("\x1b[38;2;{r};{g};{b};48;2;{s};{t};{u}m\u{2580}");
        }
        all += "\x1b[0m\n";
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_means_of_pixels() {
        // Red above blue, and a green column.
        let pixel = |i: usize| match (i % 4, i / 4) {
            (3, _) => [0, 200, 0, 255],
            (_, 0..2) => [255, 0, 0, 255],
            _ => [0, 0, 255, 255],
        };
        let rgba: Vec<u8> = (0..16).flat_map(pixel).collect();
        let text = blocks(&rgba, [4, 4], 2);
        let [left, right] = ["255;0;0;48;2;0;0;255", "127;100;0;48;2;0;100;127"].map(|c| format!("\x1b[38;2;{c}m▀"));
        assert_eq!(text, format!("{left}{right}\x1b[0m\n"));
        assert_eq!(blocks(&rgba, [4, 4], 80).lines().count(), 2);
    }

    #[test]
    fn pieces_of_kitty_join_to_the_file() {
        let png: Vec<u8> = (0..10_000_u32).map(|i| (i * 7) as u8).collect();
        let text = kitty(&png, 40);
        let pieces: Vec<&str> = text.trim_end().split("\x1b\\").filter(|piece| !piece.is_empty()).collect();
        assert!(pieces[0].starts_with("\x1b_Ga=T,f=100,c=40,m=1;") && pieces.len() == 4, "{}", pieces.len());
        assert!(pieces[3].starts_with("\x1b_Gm=0;"));
        let joined: String = pieces.iter().map(|piece| piece.split_once(';').unwrap().1).collect();
        assert_eq!(STANDARD.decode(joined).unwrap(), png);
        assert!(iterm(&png, 40).starts_with("\x1b]1337;File=inline=1;width=40;preserveAspectRatio=1;size=10000:"));
    }
}
