// A grid of voxels in Image (RAS, mm), and its linear interpolation in double precision: what the shader is compared with.
import type { Vec3 } from "../geometry/vector.ts";

export type Voxels = Uint8Array | Int8Array | Uint16Array | Int16Array | Float32Array;

// Columns of `T_image_index` (4x3, row by row: three rows of x y z offset) map a voxel's index to the position of its centre.
export interface Grid {
  readonly size: readonly [number, number, number];
  readonly T_image_index: readonly number[]; // 12 numbers: rows of [xi xj xk x0]
}

export interface Volume extends Grid {
  readonly voxels: Voxels; // i fastest
}

// Inverse of the grid's map, in the same form.
export function indexFromImage(grid: Grid): number[] {
  const m = grid.T_image_index;
  const [a, b, c, x] = m.slice(0, 4);
  const [d, e, f, y] = m.slice(4, 8);
  const [g, h, i, z] = m.slice(8, 12);
  const det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
  if (!(Math.abs(det) > 0)) throw new Error("image grid: its axes are not independent");
  const r = [
    [(e * i - f * h) / det, (c * h - b * i) / det, (b * f - c * e) / det],
    [(f * g - d * i) / det, (a * i - c * g) / det, (c * d - a * f) / det],
    [(d * h - e * g) / det, (b * g - a * h) / det, (a * e - b * d) / det],
  ];
  return r.flatMap((row) => [...row, -(row[0] * x + row[1] * y + row[2] * z)]);
}

export function apply(m: readonly number[], p: Vec3): Vec3 {
  return [
    m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3],
    m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
    m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11],
  ];
}

// Linear interpolation as ITK's: the image reaches half a voxel beyond the outer centres, where the outer values hold.
// null outside.
export function sampleLinear(volume: Volume, index: Vec3): number | null {
  const { size, voxels } = volume;
  const base = [0, 0, 0];
  const part = [0, 0, 0];
  for (let d = 0; d < 3; ++d) {
    if (!(index[d] >= -0.5 && index[d] <= size[d] - 0.5)) return null;
    const inside = Math.min(Math.max(index[d], 0), size[d] - 1);
    base[d] = Math.min(Math.floor(inside), Math.max(size[d] - 2, 0));
    part[d] = inside - base[d];
  }
  let sum = 0;
  for (let corner = 0; corner < 8; ++corner) {
    let weight = 1;
    let offset = 0;
    let stride = 1;
    for (let d = 0; d < 3; ++d) {
      const upper = (corner >> d) & 1;
      weight *= upper ? part[d] : 1 - part[d];
      offset += Math.min(base[d] + upper, size[d] - 1) * stride;
      stride *= size[d];
    }
    if (weight > 0) sum += weight * voxels[offset];
  }
  return sum;
}

// The voxel that a point of Image lies in; null outside.
export function sampleNearest(volume: Volume, point: Vec3): number | null {
  const { size, voxels } = volume;
  const [i, j, k] = apply(indexFromImage(volume), point).map(Math.round);
  const inside = [i, j, k].every((index, d) => index >= 0 && index < size[d]);
  return inside ? voxels[i + size[0] * (j + size[1] * k)] : null;
}

// Window and level: the values between level - window/2 and level + window/2 are spread over 0 to 255.
export interface Window {
  readonly window: number;
  readonly level: number;
}

export function grey(value: number, w: Window): number {
  const t = (value - (w.level - w.window / 2)) / Math.max(w.window, 1e-6);
  return 255 * Math.min(Math.max(t, 0), 1);
}
