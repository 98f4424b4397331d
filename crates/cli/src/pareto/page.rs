//! The report as one page that needs no other file.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use voxsplat::Volume;
use voxsplat_volume::names::escaped;

use super::study::{Measurement, Variant};
use super::{KeptStudy, State};

/// The factor that makes differences visible.
pub(crate) const GAIN: f64 = 50.0;

/// The content of the page.
pub(crate) struct Report<'a> {
    /// The name of the volume's file.
    pub(crate) name: &'a str,
    pub(crate) caption: Option<&'a str>,
    pub(crate) volume: &'a Volume,
    pub(crate) kept: &'a KeptStudy,
    pub(crate) state: &'a State,
    /// The indices of the best measurements, fastest first.
    pub(crate) front: &'a [usize],
    /// The command line of each measurement.
    pub(crate) commands: &'a [String],
    /// The plots as SVG.
    pub(crate) plots: &'a [String],
    pub(crate) pictures: &'a [Pictures],
}

/// A picture of the first view, and its difference from the truth at the sampled pixels, as PNG.
pub(crate) type Shots = [Vec<u8>; 2];

/// The pictures of a variant on the page.
pub(crate) struct Pictures {
    pub(crate) title: &'static str,
    pub(crate) variant: Variant,
    pub(crate) shots: Shots,
}

const STYLE: &str = "\
body{font:15px/1.5 system-ui,sans-serif;color:#222;background:#fff;max-width:1000px;margin:2em auto;padding:0 1em}\
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}svg{width:100%;height:auto}\
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}\
th,td{padding:.25em .6em;text-align:right;border-bottom:1px solid #ddd;white-space:nowrap}\
th:first-child,td:first-child,td.text,th.text{text-align:left;white-space:normal}\
tr.front{background:#eef5fb}code{background:#f3f3f3;padding:.1em .3em;overflow-wrap:anywhere;white-space:normal}\
.pair{display:flex;gap:1em;flex-wrap:wrap}.pair figure{flex:1 1 300px;margin:0}\
.pair img{width:100%;image-rendering:pixelated;background:#000}figcaption{font-size:.9em;color:#555}\
dl{display:grid;grid-template-columns:max-content 1fr;gap:.1em 1em}dt{color:#555}dd{margin:0}\
.progress{background:#fff6e0;padding:.5em .8em}.wide{overflow-x:auto}";

/// Writes the report as an HTML page.
pub(crate) fn page(report: &Report<'_>) -> String {
    let caption = report.caption.map(|caption| format!(": {caption}")).unwrap_or_default();
    let name = escaped(&format!("{}{caption}", report.name));
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <title>{name}: speed against error</title>\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<style>{STYLE}</style>\n</head>\n<body>\n\
         <h1>{name}: speed against error</h1>\n"
    );
    html += &facts(report);
    html += &progress(report);
    for plot in report.plots {
        html += plot;
        html += "\n";
    }
    html += "<h2>The front</h2>\n<p>No other way to draw the same shading and kernel is both faster and closer to the \
             truth, by the rms of its error. Numbers are those of the first plot. Diamonds are pictures by the \
             painter cpu, discs by tiles, triangles by quads, squares by other renderers.</p>\n";
    html += &table(report, report.front);
    html += "<h2>As command lines</h2>\n<ol>\n";
    for &index in report.front {
        html += &format!("<li><code>{}</code></li>\n", escaped(&report.commands[index]));
    }
    html += "</ol>\n";
    for pictures in report.pictures {
        html += &pair(pictures);
    }
    html += "<h2>All measurements</h2>\n";
    let mut all: Vec<usize> = (0..report.kept.measurements.len()).collect();
    let seconds = |&index: &usize| report.kept.measurements[index].seconds().unwrap_or(f64::INFINITY);
    all.sort_by(|a, b| seconds(a).total_cmp(&seconds(b)));
    html += &table(report, &all);
    html += &unmeasured(report.kept);
    html += "</body>\n</html>\n";
    html
}

/// Returns the progress of a study that goes on, or the part that is missing at its end.
fn progress(report: &Report<'_>) -> String {
    let State { all, left, rest, .. } = report.state;
    let missing = report.state.missing(report.kept);
    let text = match (left, missing) {
        (Some(left), _) => {
            let measured = all - report.kept.unmeasured.len();
            format!(
                "Measuring: {measured} of {all} settings are done, about {left:.0} s are left. Reload this page for \
                 more. If the study was interrupted, this command continues it:"
            )
        }
        (None, Some(missing)) => format!("The time of --seconds is used up: {missing}:"),
        (None, None) => return String::new(),
    };
    format!("<p class=\"progress\">{} <code>{}</code></p>\n", escaped(&text), escaped(rest))
}

/// Returns the settings without a measurement, by model.
fn unmeasured(kept: &KeptStudy) -> String {
    let mut models: Vec<&str> = kept.unmeasured.iter().map(|[model, _]| model.as_str()).collect();
    models.dedup();
    if models.is_empty() {
        return String::new();
    }
    let mut html = "<h2>Not measured</h2>\n<dl>\n".to_owned();
    for model in models {
        let names: Vec<&str> =
            kept.unmeasured.iter().filter(|[of, _]| of == model).map(|[_, name]| name.as_str()).collect();
        html += &format!("<dt>{}</dt><dd>{}</dd>\n", escaped(model), escaped(&names.join("; ")));
    }
    html + "</dl>\n"
}

fn facts(report: &Report<'_>) -> String {
    let subject = &report.kept.subject;
    let [x, y, z] = report.volume.grid().dims();
    let [width, height] = subject.size;
    let views = subject.views;
    let facts = [
        ("volume", format!("{x} x {y} x {z} voxels, {}", report.volume.sample_type().name())),
        ("pictures", format!("{width} x {height} pixels, {views} views")),
        (
            "truth",
            format!("f64 reference, about {} pixels of each view; each shading and kernel has its own", subject.sample),
        ),
        ("times", "medians of frames of a prepared scene, after a frame that is not timed".to_owned()),
        ("adapter", format!("{} ({})", subject.adapter, subject.driver)),
        ("version", format!("voxsplat {}", subject.version)),
        ("date", report.kept.date.clone()),
    ];
    let rows: String =
        facts.iter().map(|(name, fact)| format!("<dt>{name}</dt><dd>{}</dd>\n", escaped(fact))).collect();
    format!("<dl>\n{rows}</dl>\n")
}

/// A column of a table: its name, and its text for a measurement.
type Column = (&'static str, fn(&Measurement) -> String);

/// The columns of numbers of a table.
const COLUMNS: [Column; 8] = [
    ("frame, ms", |m| m.seconds().map(milliseconds).unwrap_or_default()),
    ("first, ms", |m| milliseconds(m.first)),
    ("rms", |m| format!("{:.2e}", m.errors.rms)),
    ("99.9 %", |m| format!("{:.2e}", m.errors.p999)),
    ("max", |m| format!("{:.2e}", m.errors.max)),
    ("PSNR, dB", |m| if m.errors.psnr > 0.0 { format!("{:.1}", m.errors.psnr) } else { "exact".to_owned() }),
    ("alpha", |m| format!("{:.2e}", m.errors.alpha)),
    ("colour", |m| format!("{:.2e}", m.errors.color)),
];

fn milliseconds(seconds: f64) -> String {
    format!("{:.1}", seconds * 1e3)
}

fn table(report: &Report<'_>, rows: &[usize]) -> String {
    let names = COLUMNS.map(|(name, _)| format!("<th>{name}</th>")).concat();
    let mut html = format!(
        "<div class=\"wide\"><table>\n<tr><th>#</th><th class=\"text\">way</th><th class=\"text\">of</th>{names}</tr>\n"
    );
    for &index in rows {
        let measured = &report.kept.measurements[index];
        let number = report.front.iter().position(|&at| at == index);
        let class = if number.is_some() { " class=\"front\"" } else { "" };
        let number = number.map(|number| (number + 1).to_string()).unwrap_or_default();
        let numbers = match &measured.refused {
            Some(reason) => format!("<td class=\"text\" colspan=\"8\">{}</td>", escaped(reason)),
            None => COLUMNS.map(|(_, text)| format!("<td>{}</td>", text(measured))).concat(),
        };
        let [name, model] = [&measured.name, &measured.model].map(|text| escaped(text));
        html += &format!(
            "<tr{class}><td>{number}</td><td class=\"text\">{name}</td><td class=\"text\">{model}</td>{numbers}</tr>\n"
        );
    }
    html + "</table></div>\n"
}

fn pair(pictures: &Pictures) -> String {
    let Pictures { title, variant, shots: [picture, difference] } = pictures;
    let figure = |png: &[u8], caption: &str| {
        let (png, alt) = (BASE64_STANDARD.encode(png), escaped(caption));
        format!(
            "<figure><img alt=\"{alt}\" src=\"data:image/png;base64,{png}\"><figcaption>{alt}</figcaption></figure>\n"
        )
    };
    format!(
        "<h2>{title}</h2>\n<p>{}: {}</p>\n<div class=\"pair\">\n{}{}</div>\n",
        escaped(&variant.model),
        escaped(&variant.name),
        figure(picture, "the picture of the first view"),
        figure(difference, &format!("its difference from the truth at the sampled pixels, times {GAIN}"))
    )
}
