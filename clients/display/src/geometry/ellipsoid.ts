// The 95 % region of a three-dimensional normal error, as wire::Ellipsoid: how it is cut by a plane, its outline on a
// plane, and its growth with the age of the pose (docs/live.md).
import { eigen2, eigen3 } from "./eigen.ts";
import type { Plane } from "./planes.ts";
import { add, dot, type Mat3, multiply, scale, sub, type Vec3 } from "./vector.ts";

// Root of the 95 % quantile of chi-square with three degrees of freedom.
export const kRadius95 = 2.7954834829151074;

export interface Ellipsoid {
  readonly semi_axes_mm: Vec3; // longest first
  readonly axes: Mat3; // row i: unit direction of semi-axis i, in Image
}

// In coordinates of a panel: u along its right, v along its up, in mm from its centre.
export interface Ellipse {
  readonly centre_mm: readonly [number, number];
  readonly semi_axes_mm: readonly [number, number]; // longest first
  readonly angle_rad: number; // of the longer semi-axis, from u towards v
}

// An error of zero in some direction is drawn as this: a flat ellipsoid has no cut in general.
const kMinSemiAxis_mm = 1e-6;

const axis = (e: Ellipsoid, i: number): Vec3 => [e.axes[3 * i], e.axes[3 * i + 1], e.axes[3 * i + 2]];

// Sum of f(semi-axis) a a^T over the axes a.
function spectral(e: Ellipsoid, f: (semiAxis_mm: number) => number): Mat3 {
  const m = [0, 0, 0, 0, 0, 0, 0, 0, 0];
  for (let i = 0; i < 3; ++i) {
    const a = axis(e, i);
    const weight = f(Math.max(e.semi_axes_mm[i], kMinSemiAxis_mm));
    for (let r = 0; r < 3; ++r) for (let c = 0; c < 3; ++c) m[3 * r + c] += weight * a[r] * a[c];
  }
  return m as unknown as Mat3;
}

// The region's surface is x = centre + shape(sphere): the point that belongs to a point of the unit sphere.
export function surfacePoint(e: Ellipsoid, centre: Vec3, onSphere: Vec3): Vec3 {
  let point = centre;
  for (let i = 0; i < 3; ++i) point = add(point, scale(axis(e, i), onSphere[i] * e.semi_axes_mm[i]));
  return point;
}

// Whether a point lies within the region around `centre`.
export function contains(e: Ellipsoid, centre: Vec3, point: Vec3): boolean {
  const d = sub(point, centre);
  const inverse = spectral(e, (s) => 1 / (s * s));
  return dot(d, multiply(inverse, d)) <= 1;
}

// Where the plane cuts the region around `centre`; null if it does not.
export function cut(e: Ellipsoid, centre: Vec3, plane: Plane): Ellipse | null {
  const A = spectral(e, (s) => 1 / (s * s));
  const p = sub(plane.centre, centre); // a point of the plane, from the region's centre
  const Au = multiply(A, plane.right);
  const Av = multiply(A, plane.up);
  const uu = dot(plane.right, Au);
  const uv = dot(plane.right, Av);
  const vv = dot(plane.up, Av);
  const bu = dot(p, Au);
  const bv = dot(p, Av);
  const determinant = uu * vv - uv * uv;
  const cu = -(vv * bu - uv * bv) / determinant;
  const cv = -(uu * bv - uv * bu) / determinant;
  const rest = 1 - dot(p, multiply(A, p)) - (bu * cu + bv * cv);
  if (!(rest > 0)) return null;
  const { values, angle_rad } = eigen2(uu, uv, vv); // the largest curvature belongs to the shorter semi-axis
  return {
    centre_mm: [cu, cv],
    semi_axes_mm: [Math.sqrt(rest / values[1]), Math.sqrt(rest / values[0])],
    angle_rad: angle_rad + Math.PI / 2,
  };
}

// The region's outline as seen along the plane's normal: what the region covers, wherever the plane cuts it.
export function outline(e: Ellipsoid, centre: Vec3, plane: Plane): Ellipse {
  const S = spectral(e, (s) => s * s);
  const Su = multiply(S, plane.right);
  const Sv = multiply(S, plane.up);
  const { values, angle_rad } = eigen2(dot(plane.right, Su), dot(plane.right, Sv), dot(plane.up, Sv));
  const d = sub(centre, plane.centre);
  return {
    centre_mm: [dot(d, plane.right), dot(d, plane.up)],
    semi_axes_mm: [Math.sqrt(Math.max(values[0], 0)), Math.sqrt(Math.max(values[1], 0))],
    angle_rad,
  };
}

// What NavigationState states about the growth; NaN where it states none.
export interface Growth {
  readonly position_velocity_covariance_mm2_s: Mat3;
  readonly velocity_covariance_mm2_s2: Mat3;
  readonly acceleration_sigma_mm_s2: number;
}

// Covariance that the region belongs to.
export function covarianceOf(e: Ellipsoid): Mat3 {
  return spectral(e, (s) => (s / kRadius95) ** 2);
}

export function regionOf(covariance_mm2: Mat3): Ellipsoid {
  const { values, vectors } = eigen3(covariance_mm2);
  const semiAxis = (value: number) => kRadius95 * Math.sqrt(Math.max(0, value));
  return {
    semi_axes_mm: [semiAxis(values[0]), semiAxis(values[1]), semiAxis(values[2])],
    axes: [...vectors[0], ...vectors[1], ...vectors[2]] as unknown as Mat3,
  };
}

// Root mean square of the error whose region this is.
export function rms_mm(e: Ellipsoid): number {
  return Math.hypot(...e.semi_axes_mm) / kRadius95;
}

// The region a time after the publication: P + dt (C + C^T) + dt^2 V + dt^4/4 a^2 I (idl/state.idl). Unchanged if the
// state carries no growth.
export function grown(e: Ellipsoid, growth: Growth, since_published_s: number): Ellipsoid {
  const C = growth.position_velocity_covariance_mm2_s;
  const V = growth.velocity_covariance_mm2_s2;
  const a = growth.acceleration_sigma_mm_s2;
  const stated = [...C, ...V, a, ...e.semi_axes_mm, ...e.axes].every(Number.isFinite);
  if (!stated || !(since_published_s > 0)) return e;
  const P = covarianceOf(e);
  const dt = since_published_s;
  const m = [0, 0, 0, 0, 0, 0, 0, 0, 0];
  for (let r = 0; r < 3; ++r) {
    for (let c = 0; c < 3; ++c) {
      const k = 3 * r + c;
      const t = 3 * c + r;
      const own = r === c ? 0.25 * dt ** 4 * a * a : 0;
      m[k] = P[k] + dt * (C[k] + C[t]) + dt * dt * 0.5 * (V[k] + V[t]) + own;
    }
  }
  return regionOf(m as unknown as Mat3);
}
