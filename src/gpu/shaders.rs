//! The WGSL of each stage: the stage's own file, then the files that it uses. The stage's file is first so that the
//! line numbers of errors are those of the file.
//!
//! A file names the files that it uses itself in a line `// uses: common/clip, common/frame`: paths in `shaders`
//! without the ending. A line of code with a number sign stands for eight, with 0 to 7 in the sign's place.

/// A stage's shader.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shader {
    /// The stage's name.
    pub name: &'static str,
    file: &'static str,
    /// The file that stores voxels, if the stage's own file does not.
    voxels: Option<&'static str>,
}

impl Shader {
    const fn new(name: &'static str) -> Self {
        Self { name, file: name, voxels: None }
    }

    const fn with(name: &'static str, file: &'static str, voxels: &'static str) -> Self {
        Self { name, file, voxels: Some(voxels) }
    }

    /// Returns the whole source, with each file once.
    pub(crate) fn source(&self) -> String {
        let mut files: Vec<&str> = std::iter::once(self.file).chain(self.voxels).collect();
        let mut texts = Vec::new();
        while let Some(file) = files.get(texts.len()) {
            let text = text_of(file).unwrap_or_default();
            texts.push(text);
            for used in uses(text) {
                if !files.contains(&used) {
                    files.push(used);
                }
            }
        }
        texts.iter().flat_map(|text| text.lines()).map(|line| written_out(line) + "\n").collect()
    }
}

/// Writes a line with a number sign eight times, all in one line, so that the numbers of lines stay.
fn written_out(line: &str) -> String {
    let is_template = line.contains('#') && !line.trim_start().starts_with("//");
    if is_template { (0..8).map(|n| line.replace('#', &n.to_string())).collect() } else { line.to_owned() }
}

/// Returns the text of a file.
fn text_of(file: &str) -> Option<&'static str> {
    FILES.iter().find(|(path, _)| *path == file).map(|(_, text)| *text)
}

/// Returns the files that a text names in its line `// uses: ..`.
fn uses(text: &'static str) -> impl Iterator<Item = &'static str> {
    text.lines().filter_map(|line| line.strip_prefix("// uses: ")).flat_map(|files| files.split(", "))
}

macro_rules! files {
    ($($path:literal),* $(,)?) => {
        [$(($path, include_str!(concat!("../../shaders/", $path, ".wgsl")))),*]
    };
}

/// All files, and their texts.
static FILES: &[(&str, &str)] = &files! {
    "around", "box_light", "cell_rows", "cells", "classify", "common/absorbed", "common/arriving",
    "common/bounds", "common/box", "common/casting", "common/cell_texels", "common/classified", "common/clip",
    "common/dispatch", "common/frame", "common/half_depth", "common/light_box", "common/light_volume",
    "common/lighting", "common/lit_splat", "common/march_parabola", "common/marking", "common/owned", "common/packing",
    "common/paged", "common/pages", "common/pixel_ray", "common/plane", "common/ray_geometry", "common/ray_parts",
    "common/rays", "common/rays_of_sweep", "common/resolution", "common/response", "common/sampled", "common/samples",
    "common/scalar_sums", "common/scalar_texels", "common/scalars", "common/splat", "common/sweep", "common/transfer",
    "common/voxel_box", "common/words", "composite", "converging", "extents", "field_of_cells", "filter", "gather",
    "gather_scalars", "list", "lit_rows", "normals", "pack_cells", "pack_samples",
    "pack_scalars", "packed/scalars", "packed/vectors", "page_table", "present", "resolve", "scalar_sums", "scan",
    "shade", "shadows_of_voxels", "skip", "sort", "splat", "sweep", "terminate",
};

macro_rules! shaders {
    ($($constant:ident: $shader:expr),* $(,)?) => {
        $(pub(crate) const $constant: Shader = $shader;)*

        /// All shaders.
        #[cfg(test)]
        pub(crate) const ALL: &[Shader] = &[$($constant),*];
    };
}

shaders! {
    CLASSIFY: Shader::new("classify"),
    EXTENTS: Shader::new("extents"),
    LIT_ROWS: Shader::new("lit_rows"),
    LIST: Shader::new("list"),
    NORMALS: Shader::new("normals"),
    CELLS: Shader::new("cells"),
    SHADOWS_OF_VOXELS: Shader::new("shadows_of_voxels"),
    FIELD_OF_CELLS: Shader::new("field_of_cells"),
    FILTER: Shader::new("filter"),
    SWEEP: Shader::new("sweep"),
    CONVERGING: Shader::new("converging"),
    AROUND: Shader::new("around"),
    BOX_LIGHT: Shader::new("box_light"),
    SCAN: Shader::new("scan"),
    SORT: Shader::new("sort"),
    SPLAT: Shader::new("splat"),
    TERMINATE: Shader::new("terminate"),
    COMPOSITE: Shader::new("composite"),
    SHADE: Shader::new("shade"),
    RESOLVE: Shader::new("resolve"),
    PACK_SAMPLES: Shader::with("pack-samples", "pack_samples", "packed/vectors"),
    PACK_SCALAR_SAMPLES: Shader::with("pack-scalar-samples", "pack_scalars", "packed/scalars"),
    PACK_GRADIENT_SAMPLES: Shader::with("pack-gradient-samples", "pack_scalars", "packed/vectors"),
    CELL_ROWS: Shader::new("cell_rows"),
    SCALAR_SUMS: Shader::new("scalar_sums"),
    PACK_SCALAR_CELLS: Shader::with("pack-scalar-cells", "pack_cells", "packed/scalars"),
    PACK_GRADIENT_CELLS: Shader::with("pack-gradient-cells", "pack_cells", "packed/vectors"),
    PAGE_TABLE: Shader::new("page_table"),
    SKIP: Shader::new("skip"),
    GATHER: Shader::new("gather"),
    GATHER_SCALARS: Shader::new("gather_scalars"),
    PRESENT: Shader::new("present"),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_use_files_that_there_are_and_no_circle_of_them() {
        let mut left: Vec<&str> = FILES.iter().map(|(file, _)| *file).collect();
        for (file, text) in FILES {
            uses(text).for_each(|used| assert!(left.contains(&used), "{file} uses {used}"));
        }
        while !left.is_empty() {
            let leans = |file: &&str| text_of(file).is_some_and(|text| uses(text).any(|used| left.contains(&used)));
            let leaning: Vec<&str> = left.iter().copied().filter(leans).collect();
            assert!(leaning.len() < left.len(), "a circle: {leaning:?}");
            left = leaning;
        }
    }

    #[test]
    fn every_file_is_part_of_a_shader_once() {
        let sources: Vec<String> = ALL.iter().map(Shader::source).collect();
        for (file, text) in FILES {
            let header = text.lines().next().unwrap();
            let times = sources.iter().map(|source| source.lines().filter(|line| *line == header).count()).max();
            assert_eq!(times, Some(1), "{file}");
        }
    }

    #[test]
    fn lines_with_a_number_sign_are_written_out() {
        assert_eq!(written_out("// all #"), "// all #");
        assert_eq!(written_out("a#(#);"), "a0(0);a1(1);a2(2);a3(3);a4(4);a5(5);a6(6);a7(7);");
    }
}
