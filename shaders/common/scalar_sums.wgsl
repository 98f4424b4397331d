// Weighted sums of scalars along an axis, on the way from voxels to cells. The stage binds `sums`.

// Sums have the range of the values in the middle of their cell too: two numbers more.
override RANGES: bool = false;

struct ScalarSums {
    // Sums along each axis.
    dims: vec3u,
    // Values along the axis of the sums; beyond them all are copies of the outermost one.
    count: u32,
    // The places in `values` between values that are neighbours along each axis.
    steps: vec3u,
    // Values between sums, as a fraction in lowest terms: sum number c begins that many whole values behind the first.
    // As many sums as the divisor have weights of their own.
    over: u32,
    // 1 along the axis of the sums.
    axis: vec3u,
    under: u32,
    // The value with the first weight in the first sum: below 0 before the first value.
    low: i32,
    // The weights of the values in the middle: the first, and the one after the last.
    first_in_block: i32,
    end_of_block: i32,
    // Sums along x: the row of voxels of the first one.
    first_y: u32,
    first_z: u32,
}

struct Sum {
    sum: f32,
    low: f32,
    high: f32,
}

// No value: its range is empty.
const NO_SUM = Sum(0.0, 3.4e38, -3.4e38);

// A sum with one more value, the `tap`-th in it.
fn with_value(sum: Sum, weight: f32, value: Sum, in_block: bool) -> Sum {
    let added = sum.sum + weight * value.sum;
    if RANGES && in_block {
        return Sum(added, min(sum.low, value.low), max(sum.high, value.high));
    }
    return Sum(added, sum.low, sum.high);
}

fn keep(index: u32, sum: Sum) {
    if RANGES {
        sums[3u * index] = sum.sum;
        sums[3u * index + 1u] = sum.low;
        sums[3u * index + 2u] = sum.high;
        return;
    }
    sums[index] = sum.sum;
}
