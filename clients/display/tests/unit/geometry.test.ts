import assert from "node:assert/strict";
import { test } from "node:test";
import * as ellipsoid from "../../src/geometry/ellipsoid.ts";
import { edgeLetters, lettersOf } from "../../src/geometry/letters.ts";
import { MeshCutter } from "../../src/geometry/mesh_cut.ts";
import * as planes from "../../src/geometry/planes.ts";
import { rmsAt } from "../../src/geometry/pose_error.ts";
import {
  add,
  along,
  distance,
  dot,
  inRigid,
  multiply,
  norm,
  rotate,
  scale,
  sub,
  turn,
  type Vec3,
} from "../../src/geometry/vector.ts";
import { Random } from "../support/random.ts";

const close = (a: number, b: number, tolerance = 1e-9) => assert.ok(Math.abs(a - b) <= tolerance, `${a} is not ${b}`);
const close3 = (a: Vec3, b: Vec3, tolerance = 1e-9) =>
  assert.ok(distance(a, b) <= tolerance, `${a.join(" ")} is not ${b.join(" ")}`);

const random = new Random(15);
const somePlane = (): planes.Plane => {
  const r = random.rotation();
  return { centre: scale(random.normal3(), 20), right: [r[0], r[1], r[2]], up: [r[3], r[4], r[5]] };
};

test("radiological pictures are seen from feet and face, neurological ones from above and behind", () => {
  const seenFrom = (kind: planes.OrthogonalKind, convention: planes.Convention) =>
    lettersOf(planes.viewer(planes.orthogonalPlane(kind, [0, 0, 0], convention)));
  assert.equal(seenFrom("axial", "radiological"), "I");
  assert.equal(seenFrom("coronal", "radiological"), "A");
  assert.equal(seenFrom("axial", "neurological"), "S");
  assert.equal(seenFrom("coronal", "neurological"), "P");
  const axial = edgeLetters(planes.orthogonalPlane("axial", [0, 0, 0], "radiological"));
  assert.deepEqual(axial, { left: "R", right: "L", top: "A", bottom: "P" });
  const sagittal = edgeLetters(planes.orthogonalPlane("sagittal", [0, 0, 0], "radiological"));
  assert.deepEqual(sagittal, { left: "A", right: "P", top: "S", bottom: "I" });
});

test("letters are right for all 24 orientations", () => {
  const letters = new Map([
    ["0,1", "R"],
    ["0,-1", "L"],
    ["1,1", "A"],
    ["1,-1", "P"],
    ["2,1", "S"],
    ["2,-1", "I"],
  ]);
  let count = 0;
  for (let i = 0; i < 3; ++i) {
    for (let j = 0; j < 3; ++j) {
      if (i === j) continue;
      for (const si of [1, -1]) {
        for (const sj of [1, -1]) {
          const right: Vec3 = [0, 1, 2].map((d) => (d === i ? si : 0)) as unknown as Vec3;
          const up: Vec3 = [0, 1, 2].map((d) => (d === j ? sj : 0)) as unknown as Vec3;
          const edges = edgeLetters({ centre: [0, 0, 0], right, up });
          assert.equal(edges.right, letters.get(`${i},${si}`));
          assert.equal(edges.left, letters.get(`${i},${-si}`));
          assert.equal(edges.top, letters.get(`${j},${sj}`));
          assert.equal(edges.bottom, letters.get(`${j},${-sj}`));
          ++count;
        }
      }
    }
  }
  assert.equal(count, 24);
});

test("an oblique direction has a second letter from 22.5 degrees on", () => {
  const at = (degrees: number) =>
    lettersOf([Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180), 0]);
  assert.equal(at(20), "R");
  assert.equal(at(30), "RA");
  assert.equal(at(60), "AR");
});

test("planes of the probe contain it, or are perpendicular to it, and are right-handed systems", () => {
  for (let k = 0; k < 1000; ++k) {
    const line = { tip: scale(random.normal3(), 30), direction: random.direction() };
    const eye = planes.probeEye(line);
    close3(planes.viewer(eye), scale(line.direction, -1)); // seen along the tool, from behind
    for (const which of [1, 2] as const) {
      const plane = planes.inline(line, which);
      close(dot(planes.viewer(plane), line.direction), 0);
      close3(plane.up, scale(line.direction, -1));
    }
    close(dot(planes.viewer(planes.inline(line, 1)), planes.viewer(planes.inline(line, 2))), 0);
    close(planes.toPlane(eye, planes.lookAhead(line, 12).centre).height_mm, -12);
    for (const plane of [eye, planes.inline(line, 1), planes.inline(line, 2)]) {
      close(norm(plane.right), 1);
      close(norm(plane.up), 1);
      close(dot(plane.right, plane.up), 0);
    }
  }
});

test("a line along anterior or superior has planes too", () => {
  for (const direction of [
    [0, 1, 0],
    [0, -1, 0],
    [0, 0, 1],
    [0, 0, -1],
  ] as Vec3[]) {
    const eye = planes.probeEye({ tip: [0, 0, 0], direction });
    close(norm(eye.up), 1);
    close3(planes.viewer(eye), scale(direction, -1));
  }
});

test("the plane along the plan contains entry and target, and follows the tip along the line", () => {
  const plane = planes.alongPlan([0, 0, 50], [0, 0, 0], [3, 4, 20]);
  close3(plane.centre, [0, 0, 20]);
  close(planes.toPlane(plane, [0, 0, 50]).height_mm, 0);
  close(planes.toPlane(plane, [0, 0, 0]).height_mm, 0);
});

test("pictures along a line keep the convention, whichever way the line points, and the face is on the left", () => {
  let shown = 0;
  for (let k = 0; k < 2000; ++k) {
    const line = { tip: [0, 0, 0] as Vec3, direction: random.direction() };
    for (const which of [1, 2] as const) {
      const plane = planes.inline(line, which);
      const radiological = planes.seenBy("radiological", plane, null);
      const neurological = planes.seenBy("neurological", plane, null);
      for (const seen of [radiological, neurological]) {
        close3(seen.up, plane.up);
        close(Math.abs(dot(planes.viewer(seen), planes.viewer(plane))), 1);
      }
      const [x, y] = plane.right;
      if (Math.abs(x) > 0.5 && Math.abs(x) > 1.5 * Math.abs(y)) {
        ++shown;
        assert.match(edgeLetters(radiological).left, /R/);
        assert.match(edgeLetters(neurological).right, /R/);
      } else if (Math.abs(y) > 0.5 && Math.abs(y) > 1.5 * Math.abs(x)) {
        ++shown;
        for (const seen of [radiological, neurological]) assert.match(edgeLetters(seen).left, /A/);
      }
    }
  }
  assert.ok(shown > 2000, String(shown));
});

test("a tool that trembles where the side changes does not make its picture jump to and fro", () => {
  for (const convention of ["radiological", "neurological"] as const) {
    for (const [axis, start] of [
      [
        [0, 1, 0],
        [0, 0, -1],
      ],
      [
        [1, 0, 0],
        [0, 0, -1],
      ],
      [
        [0, 0, 1],
        [1, 0, 0],
      ],
    ] as [Vec3, Vec3][]) {
      for (const which of [1, 2] as const) {
        let last: Vec3 | null = null;
        let jumps = 0;
        for (let step = 0; step < 3600; ++step) {
          const angle = ((step / 10 + 2 * (step % 2)) * Math.PI) / 180; // once around, trembling by 2 degrees
          const line = { tip: [0, 0, 0] as Vec3, direction: turn(start, axis, angle) };
          const { right }: planes.Plane = planes.seenBy(convention, planes.inline(line, which), last);
          if (last && dot(right, last) < 0) ++jumps;
          last = right;
        }
        assert.ok(jumps <= 6, `${convention} ${axis} ${which}: ${jumps} jumps`);
      }
    }
  }
});

test("panel and image coordinates are inverse to each other", () => {
  for (let k = 0; k < 1000; ++k) {
    const plane = somePlane();
    const [u, v] = [random.between(-90, 90), random.between(-90, 90)];
    const back = planes.toPlane(plane, planes.toImage(plane, u, v));
    close(back.u_mm, u);
    close(back.v_mm, v);
    close(back.height_mm, 0);
  }
});

test("the intersection of two planes lies in both, and parallel planes have none", () => {
  for (let k = 0; k < 1000; ++k) {
    const a = somePlane();
    const b = somePlane();
    const line = planes.intersection(a, b);
    if (!line) continue;
    for (const s of [0, 35]) {
      const point = along(line.through, line.direction, s);
      close(planes.toPlane(a, point).height_mm, 0, 1e-6);
      close(planes.toPlane(b, point).height_mm, 0, 1e-6);
    }
  }
  const plane = somePlane();
  assert.equal(planes.intersection(plane, { ...plane, centre: [1, 2, 3] }), null);
});

test("a plane is turned about a point that stays in it", () => {
  const plane = planes.orthogonalPlane("coronal", [1, 2, 3], "radiological");
  const pivot: Vec3 = [10, 2, -7];
  const turned = planes.turned(plane, pivot, [0, 0, 1], Math.PI / 6);
  close(planes.toPlane(turned, pivot).height_mm, 0);
  close(dot(planes.viewer(turned), planes.viewer(plane)), Math.cos(Math.PI / 6));
});

test("a point in another image is what its rigid matrix maps back", () => {
  const [r, t] = [random.rotation(), scale(random.normal3(), 30)];
  const T = [r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2], 0, 0, 0, 1];
  const point = scale(random.normal3(), 50);
  close3(inRigid(T, add(multiply(r, point), t)), point);
});

test("a quaternion turns as its matrix", () => {
  const half = Math.SQRT1_2;
  close3(rotate({ rotation_wxyz: [half, 0, 0, half], translation_mm: [0, 0, 0] }, [1, 0, 0]), [0, 1, 0]);
});

const someRegion = (): ellipsoid.Ellipsoid => ({
  semi_axes_mm: [random.between(2, 4), random.between(1, 2), random.between(0.2, 1)],
  axes: random.rotation(),
});

test("94 to 96 % of 10,000 draws of the covariance lie in the region drawn", () => {
  for (let k = 0; k < 10; ++k) {
    const region = someRegion();
    let inside = 0;
    for (let draw = 0; draw < 10000; ++draw) {
      const error = ellipsoid.surfacePoint(region, [0, 0, 0], scale(random.normal3(), 1 / ellipsoid.kRadius95));
      if (ellipsoid.contains(region, [0, 0, 0], error)) ++inside;
    }
    assert.ok(inside >= 9400 && inside <= 9600, `${inside} of 10,000`);
  }
});

test("points of the cut lie on the region's surface and in the plane", () => {
  let cuts = 0;
  for (let k = 0; k < 2000; ++k) {
    const region = someRegion();
    const plane = somePlane();
    const centre = along(plane.centre, planes.viewer(plane), random.between(-3, 3));
    const cut = ellipsoid.cut(region, centre, plane);
    if (!cut) continue;
    ++cuts;
    for (let angle = 0; angle < 6; angle += 0.7) {
      const point = pointOf(cut, plane, angle);
      const d = sub(point, centre);
      let form = 0;
      for (let i = 0; i < 3; ++i) {
        const a: Vec3 = [region.axes[3 * i], region.axes[3 * i + 1], region.axes[3 * i + 2]];
        form += (dot(a, d) / region.semi_axes_mm[i]) ** 2;
      }
      close(form, 1, 1e-7);
    }
  }
  assert.ok(cuts > 500);
});

test("there is no cut beyond the region, and there is one just inside", () => {
  const region = someRegion();
  const plane = somePlane();
  const reach = reachOf(region, planes.viewer(plane));
  assert.equal(ellipsoid.cut(region, along(plane.centre, planes.viewer(plane), 1.0001 * reach), plane), null);
  assert.ok(ellipsoid.cut(region, along(plane.centre, planes.viewer(plane), 0.9999 * reach), plane));
});

test("the outline touches the region's extent in every direction of the picture", () => {
  for (let k = 0; k < 500; ++k) {
    const region = someRegion();
    const plane = somePlane();
    const centre = scale(random.normal3(), 10);
    const outline = ellipsoid.outline(region, centre, plane);
    for (let angle = 0; angle < 6; angle += 0.5) {
      const direction = add(scale(plane.right, Math.cos(angle)), scale(plane.up, Math.sin(angle)));
      const [a, b] = outline.semi_axes_mm;
      const extent = Math.hypot(a * Math.cos(angle - outline.angle_rad), b * Math.sin(angle - outline.angle_rad));
      close(extent, reachOf(region, direction), 1e-9);
    }
    close(outline.centre_mm[0], dot(sub(centre, plane.centre), plane.right));
  }
});

test("the region of a covariance is that covariance again", () => {
  const region = someRegion();
  const again = ellipsoid.regionOf(ellipsoid.covarianceOf(region));
  for (let i = 0; i < 3; ++i) close(again.semi_axes_mm[i], region.semi_axes_mm[i]);
});

test("the region grows as state.idl states, and not without a stated growth", () => {
  const identity = [1, 0, 0, 0, 1, 0, 0, 0, 1] as const;
  const region: ellipsoid.Ellipsoid = {
    semi_axes_mm: [ellipsoid.kRadius95, ellipsoid.kRadius95, ellipsoid.kRadius95],
    axes: identity,
  };
  const growth: ellipsoid.Growth = {
    position_velocity_covariance_mm2_s: [2, 0, 0, 0, 0, 0, 0, 0, 0],
    velocity_covariance_mm2_s2: [0, 0, 0, 0, 50, 0, 0, 0, 0],
    acceleration_sigma_mm_s2: 1000,
  };
  const dt = 0.1;
  const own = 0.25 * dt ** 4 * 1000 ** 2;
  const expected = [1 + 2 * dt * 2 + own, 1 + dt * dt * 50 + own, 1 + own].sort((a, b) => b - a);
  const grown = ellipsoid.grown(region, growth, dt);
  expected.forEach((variance, i) => {
    close(grown.semi_axes_mm[i], ellipsoid.kRadius95 * Math.sqrt(variance), 1e-9);
  });
  close(ellipsoid.rms_mm(grown), Math.sqrt(expected[0] + expected[1] + expected[2]), 1e-9);
  assert.equal(ellipsoid.grown(region, { ...growth, acceleration_sigma_mm_s2: Number.NaN }, dt), region);
  assert.equal(ellipsoid.grown(region, growth, -1), region);
});

test("the cut of a sphere's mesh is a circle of the right radius", () => {
  const cutter = new MeshCutter(sphere(50, 64));
  const plane = { ...somePlane(), centre: [0, 0, 0] as Vec3 };
  const shifted = { ...plane, centre: scale(planes.viewer(plane), 30) };
  const { uv_mm, count } = cutter.cut(shifted);
  assert.ok(count > 100);
  for (let i = 0; i < 2 * count; ++i) {
    const radius = Math.hypot(uv_mm[2 * i], uv_mm[2 * i + 1]);
    assert.ok(radius > 39.7 && radius < 40.01, `${radius}`);
  }
  assert.equal(cutter.cut({ ...plane, centre: scale(planes.viewer(plane), 51) }).count, 0);
});

function pointOf(e: ellipsoid.Ellipse, plane: planes.Plane, angle: number): Vec3 {
  const x = e.semi_axes_mm[0] * Math.cos(angle);
  const y = e.semi_axes_mm[1] * Math.sin(angle);
  const c = Math.cos(e.angle_rad);
  const s = Math.sin(e.angle_rad);
  return planes.toImage(plane, e.centre_mm[0] + c * x - s * y, e.centre_mm[1] + s * x + c * y);
}

// Largest extent of the region from its centre in a direction.
function reachOf(region: ellipsoid.Ellipsoid, direction: Vec3): number {
  const inAxes = multiply(region.axes, direction);
  return Math.hypot(
    inAxes[0] * region.semi_axes_mm[0],
    inAxes[1] * region.semi_axes_mm[1],
    inAxes[2] * region.semi_axes_mm[2],
  );
}

function sphere(radius_mm: number, rings: number) {
  const vertices: number[] = [];
  const triangles: number[] = [];
  for (let i = 0; i <= rings; ++i) {
    for (let j = 0; j < 2 * rings; ++j) {
      const theta = (Math.PI * i) / rings;
      const phi = (Math.PI * j) / rings;
      vertices.push(
        radius_mm * Math.sin(theta) * Math.cos(phi),
        radius_mm * Math.sin(theta) * Math.sin(phi),
        radius_mm * Math.cos(theta),
      );
      if (i === rings) continue;
      const right = (j + 1) % (2 * rings);
      const [a, b, c, d] = [
        i * 2 * rings + j,
        i * 2 * rings + right,
        (i + 1) * 2 * rings + j,
        (i + 1) * 2 * rings + right,
      ];
      triangles.push(a, c, b, b, c, d);
    }
  }
  return { vertices_mm: new Float32Array(vertices), triangles: new Uint32Array(triangles) };
}

test("the error of a registration at a point is that of points moved by draws of it", () => {
  // Of a factor L: covariance L L^T, small angles.
  const L = Array.from({ length: 6 }, (_, i) =>
    Array.from({ length: 6 }, (_, j) => (j > i ? 0 : random.normal() * (i < 3 ? 2e-3 : 0.3))),
  );
  const covariance = L.flatMap((row) => L.map((other) => row.reduce((sum, value, k) => sum + value * other[k], 0)));
  const p = [40, -70, 55] as const;
  let sum = 0;
  const draws = 20_000;
  for (let n = 0; n < draws; ++n) {
    const z = Array.from({ length: 6 }, () => random.normal());
    const [a, b, c, x, y, w] = L.map((row) => row.reduce((s, value, k) => s + value * z[k], 0));
    const moved = [b * p[2] - c * p[1] + x, c * p[0] - a * p[2] + y, a * p[1] - b * p[0] + w]; // rotation x point + t
    sum += moved.reduce((s, v) => s + v * v, 0);
  }
  const ratio = rmsAt(covariance, p) / Math.sqrt(sum / draws);
  assert.ok(Math.abs(ratio - 1) < 0.02, `${ratio}`);
});
