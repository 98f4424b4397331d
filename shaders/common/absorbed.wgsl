// 1 - exp(-x) for x >= 0. Below 1/2, where the subtraction would cancel, by its series to x^7: the next term, x^8 / 8!,
// is 1e-7 there.
fn absorbed(x: f32) -> f32 {
    if x < 0.5 {
        return x * (1.0 - x * (1.0 / 2.0) * (1.0 - x * (1.0 / 3.0) * (1.0 - x * (1.0 / 4.0) * (1.0 - x * (1.0 / 5.0)
            * (1.0 - x * (1.0 / 6.0) * (1.0 - x * (1.0 / 7.0)))))));
    }
    return 1.0 - exp(-x);
}
