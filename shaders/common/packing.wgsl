// How a volume is packed for the painter `tiles`.

// Texels of zeros before each row of voxels.
const MARGIN: i32 = 7;
// Voxels along the side of the cells that are skipped where they are empty.
const CELL: i32 = 4;
