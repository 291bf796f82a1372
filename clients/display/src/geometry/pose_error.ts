// The error of a registration at a point, as algorithms/geometry/pose_covariance.hpp has it.
import type { Vec3 } from "./vector.ts";

// RMS of the error, mm. covariance: 6x6, row by row, rotation (rad) before translation (mm); left perturbation in the
// frame of the point.
export function rmsAt(covariance: readonly number[], [x, y, z]: Vec3): number {
  // Rows of the Jacobian: -[p]x and the unit matrix.
  const jacobian = [
    [0, z, -y, 1, 0, 0],
    [-z, 0, x, 0, 1, 0],
    [y, -x, 0, 0, 0, 1],
  ];
  let trace = 0;
  for (const row of jacobian) {
    for (let i = 0; i < 6; ++i) for (let j = 0; j < 6; ++j) trace += row[i] * covariance[6 * i + j] * row[j];
  }
  return Math.sqrt(Math.max(trace, 0));
}
