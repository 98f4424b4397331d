//! Options of `render` that a relative of it lacks: its help leaves them out, and a line that has one is refused.

/// The keys of `--tune` for the painter `quads`.
pub(crate) const QUADS: &str = "tune:sheets tune:accumulate tune:sheet-thickness tune:precision tune:table-error";

/// Commands, the long names of options that they lack, parted by blanks, and a text that follows the name of an option.
pub(crate) const LACKING: &[(&str, &str, &str)] = &[
    ("slice", "region save-scene", " is for a picture, not for a figure of slices"),
    ("slice", "depth", ": a depth buffer is of one picture, not of a figure of slices"),
    (
        "sheet",
        "region save-scene save-transfer stats verify labels mask overlay mesh depth reference max-error channel time",
        " is for a picture of one volume, not for a sheet of many",
    ),
    ("turntable", "save-scene verify", " is for a picture, not for a turntable"),
    ("turntable", "direction", ": a turntable turns the azimuth"),
    ("turntable", "depth", ": a depth buffer is of one view"),
    ("pareto", "legend", ": a study is of one volume of values"),
    ("pareto", "iso", ": a study compares painters, and quads draws no isosurfaces"),
    ("pareto", QUADS, ": a study varies the painters and their knobs"),
    (
        "plan",
        "region reference max-error verify stats save-scene save-transfer",
        " is for a picture, not for a plan of bricks",
    ),
    ("plan", "scale-bar axes colour-bar legend title caption units", ": a picture in bricks has no figure"),
    ("plan", "background", " is for merge, which writes the picture"),
    ("plan", "overlay", ": bricks are of one volume"),
    ("plan", "adapter", " is for brick, which draws"),
    ("plan", "iso", ": bricks have no isosurfaces"),
    ("plan", "mesh plane depth", ": a picture in bricks has no solids"),
];

/// Returns whether a command lacks an option.
pub(crate) fn lacks(command: &str, option: &str) -> bool {
    let has = |options: &str| options.split(' ').any(|name| name == option);
    LACKING.iter().any(|&(name, options, _)| name == command && has(options))
}
