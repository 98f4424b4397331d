//! Numbers of sixteen rays side by side, in the vectors of the machine.
//!
//! All operations are sums, products, fused products, quotients and square roots, whose results are the same on every
//! machine.
//!
//! There are no closures around vectors here: a closure is not compiled for the vectors of the machine.

use bytemuck::cast;
use pulp::Simd;

/// The number of rays side by side.
pub(super) const RAYS: usize = 16;
/// The count of numbers of a vector. Machines with other vectors compute with the same count.
pub(super) const WIDTH: usize = 8;
const VECTORS: usize = RAYS / WIDTH;

/// A number for each of sixteen rays.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd>([S::f32s; VECTORS]);

/// A truth value for each of sixteen rays.
#[derive(Clone, Copy)]
pub(super) struct LaneMask<S: Simd>([S::m32s; VECTORS]);

impl<S: Simd> LaneMask<S> {
    #[inline(always)]
    pub(super) fn any(self, simd: S) -> bool {
        simd.first_true_m32s(simd.or_m32s(self.0[0], self.0[1])) < WIDTH
    }

    #[inline(always)]
    pub(super) fn and(self, simd: S, other: Self) -> Self {
        Self([simd.and_m32s(self.0[0], other.0[0]), simd.and_m32s(self.0[1], other.0[1])])
    }

    #[inline(always)]
    pub(super) fn or(self, simd: S, other: Self) -> Self {
        Self([simd.or_m32s(self.0[0], other.0[0]), simd.or_m32s(self.0[1], other.0[1])])
    }

    #[inline(always)]
    pub(super) fn not(self, simd: S) -> Self {
        Self([simd.not_m32s(self.0[0]), simd.not_m32s(self.0[1])])
    }
}

/// Operations on vectors, one by one.
macro_rules! operations {
    ($($name:ident: $operation:ident),*) => {
        $(#[inline(always)]
        pub(super) fn $name(self, simd: S, other: Self) -> Self {
            Self([simd.$operation(self.0[0], other.0[0]), simd.$operation(self.0[1], other.0[1])])
        })*
    };
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(super) fn all(simd: S, value: f32) -> Self {
        Self([simd.splat_f32s(value); VECTORS])
    }

    #[inline(always)]
    pub(super) fn from_array(values: [f32; RAYS]) -> Self {
        let [first, last]: [[f32; WIDTH]; VECTORS] = cast(values);
        Self([cast(first), cast(last)])
    }

    #[inline(always)]
    pub(super) fn to_array(self) -> [f32; RAYS] {
        let first: [f32; WIDTH] = cast(self.0[0]);
        let last: [f32; WIDTH] = cast(self.0[1]);
        cast([first, last])
    }

    operations! {
        add: add_f32s, sub: sub_f32s, mul: mul_f32s, div: div_f32s, min: min_f32s, max: max_f32s
    }

    #[inline(always)]
    pub(super) fn abs(self, simd: S) -> Self {
        // The crate's own function is a call, in which vectors leave their registers.
        self.max(simd, Self::all(simd, 0.0).sub(simd, self))
    }

    #[inline(always)]
    pub(super) fn sqrt(self, simd: S) -> Self {
        Self([simd.sqrt_f32s(self.0[0]), simd.sqrt_f32s(self.0[1])])
    }

    /// Returns these numbers times `factor`, plus `sum`, rounded once.
    #[inline(always)]
    pub(super) fn fma(self, simd: S, factor: Self, sum: Self) -> Self {
        Self([simd.mul_add_f32s(self.0[0], factor.0[0], sum.0[0]), simd.mul_add_f32s(self.0[1], factor.0[1], sum.0[1])])
    }

    #[inline(always)]
    pub(super) fn less(self, simd: S, other: Self) -> LaneMask<S> {
        LaneMask([simd.less_than_f32s(self.0[0], other.0[0]), simd.less_than_f32s(self.0[1], other.0[1])])
    }

    /// Returns these numbers where the mask is true, and `other` elsewhere.
    #[inline(always)]
    pub(super) fn or(self, simd: S, mask: LaneMask<S>, other: Self) -> Self {
        Self([simd.select_f32s(mask.0[0], self.0[0], other.0[0]), simd.select_f32s(mask.0[1], self.0[1], other.0[1])])
    }

    /// Rounds down to whole numbers. Exact below 2^22.
    #[inline(always)]
    pub(super) fn floor(self, simd: S) -> Self {
        // Adding 1.5 * 2^23 rounds to a whole number.
        let magic = Self::all(simd, 12_582_912.0);
        let nearest = self.add(simd, magic).sub(simd, magic);
        let less = nearest.sub(simd, Self::all(simd, 1.0));
        less.or(simd, self.less(simd, nearest), nearest)
    }

    /// Converts whole numbers from 0 to 2^23 - 1 to indices.
    #[inline(always)]
    pub(super) fn indices(self, simd: S) -> [u32; RAYS] {
        // In a float from 2^23 on, the last bits are the whole number.
        let shifted: [u32; RAYS] = cast(self.add(simd, Self::all(simd, 8_388_608.0)).to_array());
        let mut indices = [0; RAYS];
        for ray in 0..RAYS {
            indices[ray] = shifted[ray] & 0x007f_ffff;
        }
        indices
    }

    /// Returns exp(-x) for x from -0.5 on: relative error 2e-7; 0 from 87 on.
    #[inline(always)]
    pub(super) fn exp_neg(self, simd: S) -> Self {
        let power = self.mul(simd, Self::all(simd, -std::f32::consts::LOG2_E)).max(simd, Self::all(simd, -126.0));
        let whole = power.add(simd, Self::all(simd, 0.5)).floor(simd);
        let rest = power.sub(simd, whole);
        // 2^rest by a minimax polynomial on -1/2 to 1/2 (Moshier, Cephes, exp2f).
        let mut sum = Self::all(simd, 1.535_336_2e-4);
        for coefficient in [1.339_887_4e-3, 9.618_437e-3, 5.550_332_5e-2, 0.240_226_48, std::f32::consts::LN_2, 1.0] {
            sum = sum.fma(simd, rest, Self::all(simd, coefficient));
        }
        // The exponent of a float, by the same trick as of indices.
        let mut bits: [u32; RAYS] = cast(whole.add(simd, Self::all(simd, 8_388_608.0 + 127.0)).to_array());
        for ray in 0..RAYS {
            bits[ray] <<= 23;
        }
        let value = sum.mul(simd, Self::from_array(cast(bits)));
        value.or(simd, self.less(simd, Self::all(simd, 87.0)), Self::all(simd, 0.0))
    }

    /// Returns the power of numbers from 0 to 1.
    #[inline(always)]
    pub(super) fn power(self, simd: S, exponent: f32) -> Self {
        let mut result = Self::all(simd, 1.0);
        let mut square = self;
        let mut whole = exponent as u32;
        while whole > 0 {
            if whole & 1 == 1 {
                result = result.mul(simd, square);
            }
            square = square.mul(simd, square);
            whole >>= 1;
        }
        // The binary digits of the fraction are roots.
        let mut rest = exponent.fract();
        let mut root = self;
        for _ in 0..16 {
            if rest <= 0.0 {
                break;
            }
            root = root.sqrt(simd);
            rest *= 2.0;
            if rest >= 1.0 {
                result = result.mul(simd, root);
                rest -= 1.0;
            }
        }
        result
    }

    #[inline(always)]
    pub(super) fn largest(self, simd: S) -> f32 {
        simd.reduce_max_f32s(simd.max_f32s(self.0[0], self.0[1]))
    }

    #[inline(always)]
    pub(super) fn smallest(self, simd: S) -> f32 {
        simd.reduce_min_f32s(simd.min_f32s(self.0[0], self.0[1]))
    }
}

/// Sums four channels of 4 x 4 points, given as rows of four points of four channels, with the weights of points along
/// and across. Returns two parts of each channel, to be added up.
#[inline(always)]
pub(super) fn weighted<S: Simd>(simd: S, rows: [&[f32]; 4], across: [f32; 4], along: [f32; 4]) -> S::f32s {
    let weight = simd.splat_f32s(across[0]);
    let [first, last] = halves::<S>(rows[0]);
    let (mut near, mut far) = (simd.mul_f32s(weight, first), simd.mul_f32s(weight, last));
    for row in 1..4 {
        let weight = simd.splat_f32s(across[row]);
        let [first, last] = halves::<S>(rows[row]);
        near = simd.mul_add_f32s(weight, first, near);
        far = simd.mul_add_f32s(weight, last, far);
    }
    let [a, b, c, d] = along;
    let sum = simd.mul_f32s(near, cast([a, a, a, a, b, b, b, b]));
    simd.mul_add_f32s(far, cast([c, c, c, c, d, d, d, d]), sum)
}

/// Adds up the parts of the channels of two rays: returns the channels of one ray, then of the other.
#[inline(always)]
pub(super) fn added_up<S: Simd>(simd: S, one: S::f32s, other: S::f32s) -> S::f32s {
    let one: [f32; WIDTH] = cast(one);
    let other: [f32; WIDTH] = cast(other);
    let near = cast([one[0], one[1], one[2], one[3], other[0], other[1], other[2], other[3]]);
    let far = cast([one[4], one[5], one[6], one[7], other[4], other[5], other[6], other[7]]);
    simd.add_f32s(near, far)
}

/// Returns the first two vectors of a row.
#[inline(always)]
fn halves<S: Simd>(row: &[f32]) -> [S::f32s; 2] {
    let (vectors, _) = S::as_simd_f32s(&row[..2 * WIDTH]);
    [vectors[0], vectors[1]]
}

/// The rays in the order of their channels in vectors that [`Channels::apart`] takes apart: the shuffles of the machine
/// decide on the order.
#[derive(Clone, Copy)]
pub(super) struct Order([usize; WIDTH]);

impl Order {
    #[inline(always)]
    pub(super) fn new<S: Simd>(simd: S) -> Self {
        let mut places = [[0.0_f32; WIDTH]; 4];
        for place in 0..WIDTH {
            places[place / 2][place % 2 * 4] = place as f32;
        }
        let vectors: [S::f32s; 4] = [cast(places[0]), cast(places[1]), cast(places[2]), cast(places[3])];
        let [of_rays, ..] = simd.deinterleave_shfl_f32s(vectors);
        let of_rays: [f32; WIDTH] = cast(of_rays);
        let mut rays = [0; WIDTH];
        for ray in 0..WIDTH {
            rays[of_rays[ray] as usize % WIDTH] = ray;
        }
        Self(rays)
    }

    /// Returns the two rays whose channels are in vector number `vector` of [`Channels`].
    #[inline(always)]
    pub(super) fn pair(&self, vector: usize) -> [usize; 2] {
        let first = vector / 4 * WIDTH;
        let place = vector % 4 * 2;
        // Remainders tell the compiler that both are rays.
        [(first + self.0[place]) % RAYS, (first + self.0[place + 1]) % RAYS]
    }
}

impl Order {
    /// Writes the vectors of four channels side by side, point after point.
    #[inline(always)]
    pub(super) fn write<S: Simd>(&self, simd: S, channels: [S::f32s; 4], out: &mut [f32]) {
        let beside: [[f32; WIDTH]; 4] = cast(simd.interleave_shfl_f32s(channels));
        let (out, _) = out[..4 * WIDTH].as_chunks_mut::<4>();
        for place in 0..WIDTH {
            let half = place % 2 * 4;
            let from = &beside[place / 2];
            out[self.0[place] % WIDTH] = [from[half], from[half + 1], from[half + 2], from[half + 3]];
        }
    }
}

/// Four channels of each ray side by side, of two rays in a vector.
pub(super) struct Channels<S: Simd>(pub(super) [S::f32s; 4 * VECTORS]);

impl<S: Simd> Channels<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        Self([simd.splat_f32s(0.0); 4 * VECTORS])
    }

    /// Returns the vectors of each channel.
    #[inline(always)]
    pub(super) fn apart(self, simd: S) -> [Lanes<S>; 4] {
        let [a, b, c, d, e, f, g, h] = self.0;
        let first = simd.deinterleave_shfl_f32s([a, b, c, d]);
        let last = simd.deinterleave_shfl_f32s([e, f, g, h]);
        [Lanes([first[0], last[0]]), Lanes([first[1], last[1]]), Lanes([first[2], last[2]]), Lanes([first[3], last[3]])]
    }
}

/// Returns the first numbers of a slice as a vector.
#[inline(always)]
pub(super) fn load<S: Simd>(_: S, numbers: &[f32]) -> S::f32s {
    let (vectors, _) = S::as_simd_f32s(&numbers[..WIDTH]);
    vectors[0]
}

/// Returns the first four numbers of two slices as a vector.
#[inline(always)]
pub(super) fn fours<S: Simd>(one: &[f32], other: &[f32]) -> S::f32s {
    let (one, other) = (&one[..4], &other[..4]);
    cast([one[0], one[1], one[2], one[3], other[0], other[1], other[2], other[3]])
}

/// Returns a vector of one number four times, then another four times.
#[inline(always)]
pub(super) fn twice_four<S: Simd>(one: f32, other: f32) -> S::f32s {
    cast([one, one, one, one, other, other, other, other])
}

/// Three results of an expression in the number of an axis or a channel. In place of a closure: see above.
macro_rules! three {
    ($number:ident => $value:expr) => {
        [
            {
                let $number = 0;
                $value
            },
            {
                let $number = 1;
                $value
            },
            {
                let $number = 2;
                $value
            },
        ]
    };
}
pub(super) use three;

#[cfg(test)]
mod tests {
    use std::array::from_fn;

    use pulp::WithSimd;

    use super::*;
    use crate::vectors::dispatch;

    struct Functions;

    impl WithSimd for Functions {
        type Output = Vec<[f32; RAYS]>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let x = Lanes::<S>::from_array(from_fn(|i| 0.37 * i as f32 - 0.3));
            let unit = Lanes::<S>::from_array(from_fn(|i| i as f32 / 15.0));
            vec![
                x.floor(simd).to_array(),
                x.exp_neg(simd).to_array(),
                unit.power(simd, 24.0).to_array(),
                unit.power(simd, 2.75).to_array(),
                x.fma(simd, x, x).to_array(),
            ]
        }
    }

    #[test]
    fn functions_are_exact_and_the_same_at_every_level() {
        let found = dispatch(Functions);
        let x = |i: usize| 0.37 * i as f32 - 0.3;
        let unit = |i: usize| i as f32 / 15.0;
        for i in 0..RAYS {
            assert_eq!(found[0][i], x(i).floor());
            assert!((found[1][i] / (-x(i)).exp() - 1.0).abs() < 4e-7, "{}", found[1][i]);
            assert!((found[2][i] - unit(i).powi(24)).abs() < 1e-6);
            assert!((found[3][i] - unit(i).powf(2.75)).abs() < 1e-6);
            assert_eq!(found[4][i], x(i).mul_add(x(i), x(i)));
        }
        assert_eq!(found, Simd::vectorize(pulp::Scalar256b, Functions));
    }
}
