// Vectors, rotations and poses in double precision. Lengths in mm, frames as in docs/architecture.md (Image is RAS).
// Nothing here changes its arguments.

export type Vec3 = readonly [number, number, number];
// Row by row.
export type Mat3 = readonly [number, number, number, number, number, number, number, number, number];

export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vec3, s: number): Vec3 => [a[0] * s, a[1] * s, a[2] * s];
// a + s * b
export const along = (a: Vec3, b: Vec3, s: number): Vec3 => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const norm = (a: Vec3): number => Math.hypot(a[0], a[1], a[2]);
export const distance = (a: Vec3, b: Vec3): number => norm(sub(a, b));
export const negate = (a: Vec3): Vec3 => [-a[0], -a[1], -a[2]];
export const isFinite3 = (a: Vec3): boolean => Number.isFinite(a[0] + a[1] + a[2]);

// The zero vector has no direction and stays what it is.
export function unit(a: Vec3): Vec3 {
  const length = norm(a);
  return length > 0 ? scale(a, 1 / length) : a;
}

// Unit vector at a right angle to the unit vector `axis`, as near to `wanted` as possible.
export function perpendicular(axis: Vec3, wanted: Vec3): Vec3 {
  return unit(along(wanted, axis, -dot(axis, wanted)));
}

export const multiply = (m: Mat3, v: Vec3): Vec3 => [
  m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
  m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
  m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
];

// The point of the source frame that a rigid matrix (4 x 4, row by row) maps to `p`.
export function inRigid(T: readonly number[], p: Vec3): Vec3 {
  const d: Vec3 = [p[0] - T[3], p[1] - T[7], p[2] - T[11]];
  return [
    T[0] * d[0] + T[4] * d[1] + T[8] * d[2],
    T[1] * d[0] + T[5] * d[1] + T[9] * d[2],
    T[2] * d[0] + T[6] * d[1] + T[10] * d[2],
  ];
}

// Turns `v` about the unit vector `axis`, right-handed (Rodrigues).
export function turn(v: Vec3, axis: Vec3, angle_rad: number): Vec3 {
  const c = Math.cos(angle_rad);
  const s = Math.sin(angle_rad);
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}

// Maps points of the source frame into the target frame, as wire::Pose.
export interface Pose {
  readonly rotation_wxyz: readonly [number, number, number, number];
  readonly translation_mm: Vec3;
}

export function rotate(pose: Pose, v: Vec3): Vec3 {
  const [w, x, y, z] = pose.rotation_wxyz;
  const u: Vec3 = [x, y, z];
  const t = scale(cross(u, v), 2);
  return add(along(v, t, w), cross(u, t));
}

export const transform = (pose: Pose, point: Vec3): Vec3 => add(rotate(pose, point), pose.translation_mm);
