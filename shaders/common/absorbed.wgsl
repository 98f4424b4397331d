// 1 - exp(-x) for x >= 0. Below 1/2 the subtraction would cancel, so the series to x^7 replaces it: the next term,
// x^8 / 8!, is at most 1e-7.
fn absorbed(x: f32) -> f32 {
    if x < 0.5 {
        return x * (1.0 - x * (1.0 / 2.0) * (1.0 - x * (1.0 / 3.0) * (1.0 - x * (1.0 / 4.0) * (1.0 - x * (1.0 / 5.0)
            * (1.0 - x * (1.0 / 6.0) * (1.0 - x * (1.0 / 7.0)))))));
    }
    return 1.0 - exp(-x);
}
