"""Simulates pictures in bricks on 1 to 1000 workers: python python/benches/scaling.py

A list scheduler hands bricks in order to the next free worker. A task costs the scheduler TASK seconds, one after the
other. A worker reads the slice of a brick at READ bytes a second, of which the store gives at most STORE to all workers
together, and draws DRAW seconds a voxel of the slice. Partial pictures are composited in a tree of BRANCHES, after they
were moved at NET bytes a second; the picture of the root is the whole one. The costs were measured on two cores with
software Vulkan; see docs/measurements/2026-11-25-clusters.md.
"""

from __future__ import annotations

import argparse
import heapq
import math

BRANCHES = 8
# Bytes of a pixel of a partial picture, and seconds to composite one.
PIXEL, OVER = 16, 8e-9
HALO = 6


def simulated(args: argparse.Namespace, side: int, workers: int, pixels: int) -> tuple[int, float, float, int, float]:
    """The bricks, gigabytes read, gigabytes moved, depth of the tree, and seconds."""
    # Bricks that fit into a worker, at least two for each worker, none of them below 64 voxels.
    grid = max(math.ceil(side / args.edge), math.ceil((2 * workers) ** (1 / 3)))
    grid = min(grid, max(side // 64, 1))
    bricks, edge = grid**3, side / grid
    held = (edge + 2 * HALO) ** 3
    read = min(args.read, args.store / workers)
    duration = held * 2 / read + held * args.draw + args.fixed
    free = [0.0] * workers
    for number in range(bricks):
        at = max(heapq.heappop(free), number * args.task)
        heapq.heappush(free, at + duration)
    seconds, moved, parts, depth = max(free), 0.0, bricks, 0
    # The box of pixels of a turned brick is about twice its face.
    area = min(2 * (pixels / grid) ** 2, pixels**2)
    while parts > 1:
        nodes = math.ceil(parts / BRANCHES)
        size = BRANCHES * area * PIXEL
        moved += parts * area * PIXEL
        area = min(area * BRANCHES ** (2 / 3), pixels**2)
        rounds = math.ceil(nodes / workers)
        seconds += rounds * (size / args.net + BRANCHES * area * OVER) + nodes * args.task
        parts, depth = nodes, depth + 1
    return bricks, held * bricks * 2 / 1e9, moved / 1e9, depth, seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--read", type=float, default=200e6, help="bytes a second that a worker reads")
    parser.add_argument("--store", type=float, default=10e9, help="bytes a second that the store gives to all")
    parser.add_argument("--net", type=float, default=1e9, help="bytes a second between workers")
    parser.add_argument("--draw", type=float, default=50e-9, help="seconds a voxel of a slice")
    parser.add_argument("--fixed", type=float, default=0.12, help="seconds a brick")
    parser.add_argument("--task", type=float, default=1e-3, help="seconds of the scheduler a task")
    parser.add_argument("--edge", type=int, default=320, help="voxels along the largest brick that fits")
    parser.add_argument("--pixels", type=int, default=2048, help="side of the picture")
    args = parser.parse_args()
    print("| volume, 2 bytes a voxel | workers | bricks | read, GB | moved, GB | depth | seconds | speed-up |")
    print("|---|---|---|---|---|---|---|---|")
    for name, side in [("2048^3, 17 GB", 2048), ("8192^3, 1.1 TB", 8192)]:
        first = 0.0
        for workers in (1, 10, 100, 1000):
            bricks, read, moved, depth, seconds = simulated(args, side, workers, args.pixels)
            first = first or seconds
            print(f"| {name} | {workers} | {bricks} | {read:.0f} | {moved:.1f} | {depth} | {seconds:.0f} | {first / seconds:.0f} |")


if __name__ == "__main__":
    main()
