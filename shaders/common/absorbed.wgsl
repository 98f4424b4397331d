// 1 - exp(-x) for x >= 0, by its series where the subtraction would cancel: x^9 / 9! is below f32 rounding at 1/2.
fn absorbed(x: f32) -> f32 {
    if x < 0.5 {
        return x * (1.0 - x * (1.0 / 2.0) * (1.0 - x * (1.0 / 3.0) * (1.0 - x * (1.0 / 4.0) * (1.0 - x * (1.0 / 5.0)
            * (1.0 - x * (1.0 / 6.0) * (1.0 - x * (1.0 / 7.0)))))));
    }
    return 1.0 - exp(-x);
}
