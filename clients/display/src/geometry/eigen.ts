// Eigenvalues of symmetric matrices: Jacobi's rotations for 3x3, closed form for 2x2.
import type { Mat3, Vec3 } from "./vector.ts";

export interface Eigen3 {
  readonly values: Vec3; // largest first
  readonly vectors: readonly [Vec3, Vec3, Vec3]; // unit, in the order of the values
}

export function eigen3(symmetric: Mat3): Eigen3 {
  const a = [symmetric.slice(0, 3), symmetric.slice(3, 6), symmetric.slice(6, 9)];
  const v = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  for (let sweep = 0; sweep < 30; ++sweep) {
    const off = a[0][1] ** 2 + a[0][2] ** 2 + a[1][2] ** 2;
    const diagonal = a[0][0] ** 2 + a[1][1] ** 2 + a[2][2] ** 2;
    if (!(off > 1e-32 * diagonal)) break;
    rotateAway(a, v, 0, 1);
    rotateAway(a, v, 0, 2);
    rotateAway(a, v, 1, 2);
  }
  const order = [0, 1, 2].sort((i, j) => a[j][j] - a[i][i]);
  const column = (i: number): Vec3 => [v[0][i], v[1][i], v[2][i]];
  return {
    values: [a[order[0]][order[0]], a[order[1]][order[1]], a[order[2]][order[2]]],
    vectors: [column(order[0]), column(order[1]), column(order[2])],
  };
}

// One rotation that makes a[p][q] zero; v collects the rotations.
function rotateAway(a: number[][], v: number[][], p: number, q: number): void {
  if (a[p][q] === 0) return;
  const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
  const t = Math.sign(theta || 1) / (Math.abs(theta) + Math.hypot(theta, 1));
  const c = 1 / Math.hypot(t, 1);
  const s = t * c;
  for (let k = 0; k < 3; ++k) {
    const kp = a[k][p];
    const kq = a[k][q];
    a[k][p] = c * kp - s * kq;
    a[k][q] = s * kp + c * kq;
  }
  for (let k = 0; k < 3; ++k) {
    const pk = a[p][k];
    const qk = a[q][k];
    a[p][k] = c * pk - s * qk;
    a[q][k] = s * pk + c * qk;
  }
  for (let k = 0; k < 3; ++k) {
    const kp = v[k][p];
    const kq = v[k][q];
    v[k][p] = c * kp - s * kq;
    v[k][q] = s * kp + c * kq;
  }
}

export interface Eigen2 {
  readonly values: readonly [number, number]; // largest first
  readonly angle_rad: number; // of the first eigenvector
}

// Of ((xx, xy), (xy, yy)).
export function eigen2(xx: number, xy: number, yy: number): Eigen2 {
  const mean = (xx + yy) / 2;
  const half = Math.hypot((xx - yy) / 2, xy);
  return { values: [mean + half, mean - half], angle_rad: 0.5 * Math.atan2(2 * xy, xx - yy) };
}
