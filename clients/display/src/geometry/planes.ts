// The planes that panels show. A plane has a centre and two unit vectors in Image (RAS): `right` and `up` of the
// picture. right x up points to the viewer.
import { add, along, cross, dot, negate, perpendicular, scale, sub, turn, unit, type Vec3 } from "./vector.ts";

export interface Plane {
  readonly centre: Vec3;
  readonly right: Vec3;
  readonly up: Vec3;
}

// Radiological: the patient's right is on the left of axial and coronal pictures, as seen from feet and face.
// Neurological: on the right, as seen from above and behind.
export type Convention = "radiological" | "neurological";

export const kOrthogonalKinds = ["axial", "coronal", "sagittal"] as const;
export const kProbeKinds = ["probe_eye", "inline_1", "inline_2", "along_plan", "look_ahead"] as const;
export type OrthogonalKind = (typeof kOrthogonalKinds)[number];
export type ProbeKind = (typeof kProbeKinds)[number];
export type SliceKind = OrthogonalKind | ProbeKind;

const kRight: Vec3 = [1, 0, 0];
const kAnterior: Vec3 = [0, 1, 0];
const kSuperior: Vec3 = [0, 0, 1];

export const viewer = (plane: Plane): Vec3 => cross(plane.right, plane.up);

export function orthogonalPlane(kind: OrthogonalKind, centre: Vec3, convention: Convention): Plane {
  const leftRight = convention === "radiological" ? negate(kRight) : kRight;
  switch (kind) {
    case "axial":
      return { centre, right: leftRight, up: kAnterior };
    case "coronal":
      return { centre, right: leftRight, up: kSuperior };
    case "sagittal": // the face to the left, in both conventions
      return { centre, right: negate(kAnterior), up: kSuperior };
  }
}

// What a plane with the probe follows: a tool, or a planned line in its place.
export interface Line {
  readonly tip: Vec3;
  readonly direction: Vec3; // unit, towards the tip and beyond
}

// Perpendicular to the line at its tip, seen along the line. Up is anterior, or superior for a line along it; a turn of
// the tool about its own axis does not turn the picture.
export function probeEye(line: Line): Plane {
  const wanted = Math.abs(line.direction[1]) < 0.9 ? kAnterior : kSuperior;
  const up = perpendicular(line.direction, wanted);
  return { centre: line.tip, right: cross(line.direction, up), up };
}

// The probe's eye `ahead_mm` beyond the tip.
export function lookAhead(line: Line, ahead_mm: number): Plane {
  return { ...probeEye(line), centre: along(line.tip, line.direction, ahead_mm) };
}

// Contains the line, which points down in the picture. The second one is at a right angle to the first.
export function inline(line: Line, which: 1 | 2): Plane {
  const eye = probeEye(line);
  return { centre: line.tip, right: which === 1 ? eye.right : eye.up, up: negate(line.direction) };
}

// Contains the planned line, centred where the tip is along it. Its turn about the line is that which shows the tip's
// deviation in the picture; without one (`tip` on the line, or null) that of the first in-line plane.
export function alongPlan(entry: Vec3, target: Vec3, tip: Vec3 | null): Plane {
  const direction = unit(sub(target, entry));
  const line: Line = { tip: target, direction };
  const plain = inline(line, 1);
  if (!tip) return plain;
  return { ...plain, centre: along(entry, direction, dot(sub(tip, entry), direction)) };
}

const kClear = 0.35; // component along an axis of the patient from which it decides the side of a picture
const kBetween = 0.7; // of the larger component: closer ones are between two axes

// The plane, or its mirror image seen from the other side, as the convention asks: the patient's right on the left of
// radiological pictures, and on the right of neurological ones; the face on the left where the picture is rather
// sagittal. Where neither is clear, as of a line from the side, the side is that of `last`, the picture's right before: a
// tool that is turned there must not make its picture jump to and fro.
export function seenBy(convention: Convention, plane: Plane, last: Vec3 | null): Plane {
  const mirrored = { ...plane, right: negate(plane.right) };
  const [x, y] = plane.right;
  const [larger, smaller] = [Math.max(Math.abs(x), Math.abs(y)), Math.min(Math.abs(x), Math.abs(y))];
  if (last && (larger < kClear || smaller > kBetween * larger)) return dot(plane.right, last) >= 0 ? plane : mirrored;
  const isRight = Math.abs(x) >= Math.abs(y) ? x > 0 === (convention === "neurological") : y <= 0;
  return isRight ? plane : mirrored;
}

// Image position of a point of the picture (u right, v up, mm from the centre).
export function toImage(plane: Plane, u_mm: number, v_mm: number): Vec3 {
  return add(plane.centre, add(scale(plane.right, u_mm), scale(plane.up, v_mm)));
}

export interface PanelPoint {
  readonly u_mm: number;
  readonly v_mm: number;
  readonly height_mm: number; // towards the viewer
}

export function toPlane(plane: Plane, point: Vec3): PanelPoint {
  const d = sub(point, plane.centre);
  return { u_mm: dot(d, plane.right), v_mm: dot(d, plane.up), height_mm: dot(d, viewer(plane)) };
}

// The plane turned about `axis` through `pivot`.
export function turned(plane: Plane, pivot: Vec3, axis: Vec3, angle_rad: number): Plane {
  return {
    centre: add(pivot, turn(sub(plane.centre, pivot), axis, angle_rad)),
    right: turn(plane.right, axis, angle_rad),
    up: turn(plane.up, axis, angle_rad),
  };
}

// The same plane, its centre moved in the plane to the foot of `point` on it.
export function centredAt(plane: Plane, point: Vec3): Plane {
  return { ...plane, centre: along(point, viewer(plane), -toPlane(plane, point).height_mm) };
}

export interface PlaneLine {
  readonly through: Vec3;
  readonly direction: Vec3;
}

// Where two planes meet; null if they are nearly parallel.
export function intersection(a: Plane, b: Plane): PlaneLine | null {
  const na = viewer(a);
  const nb = viewer(b);
  const crossed = cross(na, nb);
  const sine2 = dot(crossed, crossed);
  if (sine2 < 1e-8) return null;
  const ha = dot(na, a.centre);
  const hb = dot(nb, b.centre);
  const c = dot(na, nb);
  const through = add(scale(na, (ha - hb * c) / sine2), scale(nb, (hb - ha * c) / sine2));
  return { through, direction: scale(crossed, 1 / Math.sqrt(sine2)) };
}
