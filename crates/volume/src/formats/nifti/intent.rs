//! The meaning of values by the intent codes of NIfTI. AFNI numbers its statistics in the same way.

use crate::names::readable;

/// The codes of labels: of any table, and of NeuroNames.
const LABELS: [i32; 2] = [1002, 1003];

/// The meanings of codes, the first of which are codes of statistics.
const MEANINGS: [(i32, &str); 46] = [
    (2, "correlation coefficient"),
    (3, "t statistic"),
    (4, "F statistic"),
    (5, "z score"),
    (6, "chi-squared statistic"),
    (7, "beta statistic"),
    (8, "binomial statistic"),
    (9, "gamma statistic"),
    (10, "Poisson statistic"),
    (11, "normal statistic"),
    (12, "noncentral F statistic"),
    (13, "noncentral chi-squared statistic"),
    (14, "logistic statistic"),
    (15, "Laplace statistic"),
    (16, "uniform statistic"),
    (17, "noncentral t statistic"),
    (18, "Weibull statistic"),
    (19, "chi statistic"),
    (20, "inverse Gaussian statistic"),
    (21, "extreme value statistic"),
    (22, "p-value"),
    (23, "-ln p"),
    (24, "-log10 p"),
    (1001, "estimate of a parameter"),
    (1002, "labels"),
    (1003, "labels of NeuroNames"),
    (1004, "matrices"),
    (1005, "symmetric matrices"),
    (1006, "displacements"),
    (1007, "vectors"),
    (1008, "points"),
    (1009, "triangles"),
    (1010, "quaternions"),
    (1011, "dimensionless numbers"),
    (2001, "time series"),
    (2002, "numbers of nodes"),
    (2003, "red, green and blue"),
    (2004, "red, green, blue and alpha"),
    (2005, "shape"),
    (2006, "displacements of FNIRT"),
    (2007, "coefficients of cubic splines, FNIRT"),
    (2008, "coefficients of cosines, FNIRT"),
    (2009, "coefficients of quadratic splines, FNIRT"),
    (2016, "coefficients of cubic splines, TOPUP"),
    (2017, "coefficients of quadratic splines, TOPUP"),
    (2018, "field of TOPUP"),
];

/// Returns whether values of this code are labels.
pub(in crate::formats) fn are_labels(code: i32) -> bool {
    LABELS.contains(&code)
}

/// Returns the short name of a statistic, as a unit of values.
pub(in crate::formats) fn unit(code: i32) -> Option<&'static str> {
    match code {
        2 => Some("r"),
        3 => Some("t"),
        4 => Some("F"),
        5 => Some("z"),
        22 => Some("p"),
        _ => None,
    }
}

/// Returns the meaning of a code with the parameters of its distribution; `None` if the code states nothing.
pub(in crate::formats) fn meaning(code: i32, parameters: &[f64]) -> Option<String> {
    let name = match MEANINGS.iter().find(|(known, _)| *known == code) {
        Some((_, name)) => *name,
        None if code == 0 => return None,
        None => return Some(format!("code {code}")),
    };
    // Degrees of freedom; a header leaves those that it does not know at 0.
    let freedom: &[f64] = parameters.get(..if code == 4 { 2 } else { 1 }).unwrap_or_default();
    let is_stated = [2, 3, 4, 6].contains(&code) && !freedom.is_empty() && freedom.iter().all(|n| *n > 0.0);
    let numbers: Vec<String> = freedom.iter().map(|n| readable(*n)).collect();
    Some(match is_stated && freedom.iter().all(|n| n.is_finite()) {
        true => format!("{name} with {} degrees of freedom", numbers.join(" and ")),
        false => name.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_meanings_in_words() {
        let of = |code: i32, parameters: &[f64]| meaning(code, parameters).unwrap_or_default();
        assert_eq!(of(0, &[]), "");
        assert_eq!(of(3, &[12.0, 0.0, 0.0]), "t statistic with 12 degrees of freedom");
        assert_eq!(of(4, &[2.0, 12.5, 0.0]), "F statistic with 2 and 12.5 degrees of freedom");
        assert_eq!(of(4, &[2.0, 0.0, 0.0]), "F statistic");
        assert_eq!(of(3, &[f64::NAN]), "t statistic");
        assert_eq!(
            (of(5, &[3.0]).as_str(), of(1002, &[]).as_str(), of(999, &[]).as_str()),
            ("z score", "labels", "code 999")
        );
        assert!(MEANINGS.is_sorted_by_key(|(code, _)| *code));
    }
}
