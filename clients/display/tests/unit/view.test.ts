import assert from "node:assert/strict";
import { test } from "node:test";
import { toPlane, viewer } from "../../src/geometry/planes.ts";
import { distance, dot, type Vec3 } from "../../src/geometry/vector.ts";
import { advice, volumeText } from "../../src/page/camera_page.ts";
import { tipText, validityText } from "../../src/page/scanner_page.ts";
import { orbit, viewMatrix } from "../../src/render/camera.ts";
import type { CaseData } from "../../src/state/case_data.ts";
import { CaptureKind, DeviceKind, PoseStatus, RegistrationStatus } from "../../src/state/constants.ts";
import { decodeFrame } from "../../src/state/frame.ts";
import type { RecordOf } from "../../src/state/layout.ts";
import { Store } from "../../src/state/store.ts";
import { figure } from "../../src/state/text.ts";
import { kMaxLiveAge_ms } from "../../src/state/validity.ts";
import { Captures } from "../../src/view/captures.ts";
import { kColours } from "../../src/view/colours.ts";
import { coverageOf, leastCovered } from "../../src/view/coverage.ts";
import { panelRects } from "../../src/view/layout.ts";
import { distanceColour, type SceneTool, sceneOf } from "../../src/view/scene.ts";
import { SkinDistance } from "../../src/view/skin_distance.ts";
import { insetOf } from "../../src/view/skin_points.ts";
import { TipTrace } from "../../src/view/tip_trace.ts";
import { ViewState } from "../../src/view/view_state.ts";
import { encodeFrame, liveTool, record, type TestRecord } from "../support/frames.ts";
import { Random } from "../support/random.ts";

const nothing = { line: null, trajectory: null };
const planes = (view: ViewState) =>
  (["axial", "coronal", "sagittal"] as const).map((kind) => view.planeOf(kind, nothing)!);

test("the three planes meet in the cross hair, also when they were turned", () => {
  const view = new ViewState();
  view.setCursor([10, -20, 30]);
  view.turnOthers("axial", 0.4);
  view.turnOthers("coronal", -0.2);
  for (const plane of planes(view)) assert.ok(Math.abs(toPlane(plane, [10, -20, 30]).height_mm) < 1e-9);
  assert.ok(view.oblique);
  view.straighten();
  assert.ok(!view.oblique);
});

test("turning in the axial panel turns the other two, which stay at a right angle", () => {
  const view = new ViewState();
  const [axial, coronal, sagittal] = planes(view).map(viewer);
  view.turnOthers("axial", Math.PI / 6);
  const [a, c, s] = planes(view).map(viewer);
  assert.ok(distance(a, axial) < 1e-12);
  assert.ok(Math.abs(dot(c, coronal) - Math.cos(Math.PI / 6)) < 1e-12);
  assert.ok(Math.abs(dot(s, sagittal) - Math.cos(Math.PI / 6)) < 1e-12);
  assert.ok(Math.abs(dot(c, s)) < 1e-12);
});

test("a step moves a plane along its own normal only, and ends following the tip", () => {
  const view = new ViewState();
  view.turnOthers("axial", 0.5);
  const before = view.planeOf("coronal", nothing)!;
  view.step("coronal", 3);
  const after = view.planeOf("coronal", nothing)!;
  assert.ok(Math.abs(toPlane(before, after.centre).height_mm - 3) < 1e-9);
  assert.equal(view.follow, false);
});

test("while following, the planes go through the tip; a click ends it", () => {
  const view = new ViewState();
  view.track({ line: { tip: [1, 2, 3], direction: [0, 0, -1] }, trajectory: null });
  assert.deepEqual(view.cursor, [1, 2, 3]);
  view.setCursor([9, 9, 9]);
  view.track({ line: { tip: [4, 5, 6], direction: [0, 0, -1] }, trajectory: null });
  assert.deepEqual(view.cursor, [9, 9, 9]);
});

test("a cross hair that was left at a hidden tool's tip is known as such, and one that was set is not", () => {
  const view = new ViewState();
  assert.equal(view.isAtLastTip, false);
  view.track({ line: { tip: [1, 2, 3], direction: [0, 0, 1] }, trajectory: null });
  view.track(nothing);
  assert.equal(view.isAtLastTip, true);
  view.setCursor([0, 0, 0]);
  assert.equal(view.isAtLastTip, false);
});

test("zooming keeps the point under the pointer", () => {
  const view = new ViewState();
  const rect = { x: 0, y: 0, width: 500, height: 400 };
  const at = (u: number, v: number) => {
    const picture = view.pictureOf(0, nothing)!;
    const mm = view.mm_per_pixel(0, rect);
    return [0, 1, 2].map(
      (d) => picture.centre[d] + picture.right[d] * u * mm + picture.up[d] * v * mm,
    ) as unknown as Vec3;
  };
  const before = at(120, -60);
  view.zoomAt(0, 2.5, 120 * view.mm_per_pixel(0, rect), -60 * view.mm_per_pixel(0, rect));
  assert.ok(distance(at(120, -60), before) < 1e-9);
});

test("panels of every layout lie side by side in the picture", () => {
  for (const layout of ["2x2", "1+3", "one"] as const) {
    for (let big = 0; big < 4; ++big) {
      const rects = panelRects(layout, big, 1001, 701).filter((r) => r !== null);
      assert.equal(rects.length, layout === "one" ? 1 : 4);
      for (const [i, a] of rects.entries()) {
        assert.ok(a.x >= 0 && a.y >= 0 && a.x + a.width <= 1001 && a.y + a.height <= 701);
        for (const b of rects.slice(i + 1)) {
          const apart = a.x + a.width <= b.x || b.x + b.width <= a.x || a.y + a.height <= b.y || b.y + b.height <= a.y;
          assert.ok(apart);
        }
      }
    }
  }
});

test("the camera's matrix maps its own axes to those of the picture, and turning keeps it a rotation", () => {
  let camera = { centre: [1, 2, 3] as Vec3, right: [1, 0, 0] as Vec3, up: [0, 0, 1] as Vec3, mm_per_pixel: 0.5 };
  for (let i = 0; i < 50; ++i) camera = { ...camera, ...orbit(camera, 0.3, -0.17) };
  assert.ok(Math.abs(dot(camera.right, camera.up)) < 1e-9);
  const m = viewMatrix(camera, 400, 200);
  const clip = (p: Vec3) => [0, 1, 2].map((r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
  const right = camera.centre.map((c, d) => c + 100 * camera.right[d]) as unknown as Vec3; // half the width
  assert.ok(Math.abs(clip(right)[0] - 1) < 1e-5 && Math.abs(clip(right)[1]) < 1e-5);
  const nearer = camera.centre.map((c, d) => c + 10 * viewer(camera)[d]) as unknown as Vec3;
  assert.ok(clip(nearer)[2] < clip(camera.centre)[2]);
});

test("distances from a surface equal those to all of its triangles", () => {
  // A square of 100 mm at z = 0 in two triangles, and a small one far away.
  const mesh = {
    vertices_mm: new Float32Array([-50, -50, 0, 50, -50, 0, 50, 50, 0, -50, 50, 0, 0, 0, 90, 5, 0, 90, 0, 5, 90]),
    triangles: new Uint32Array([0, 1, 2, 0, 2, 3, 4, 5, 6]),
  };
  const skin = new SkinDistance(mesh);
  const random = new Random(9);
  for (let k = 0; k < 500; ++k) {
    const p: Vec3 = [random.between(-70, 70), random.between(-70, 70), random.between(-25, 25)];
    const over = [0, 1].map((d) => Math.max(Math.abs(p[d]) - 50, 0));
    assert.ok(Math.abs(Math.abs(skin.of(p)) - Math.hypot(over[0], over[1], p[2])) < 1e-6);
  }
  assert.equal(skin.of([0, 0, 900]), Number.POSITIVE_INFINITY);
});

test("distances are positive outside and negative inside, beside faces, edges and corners", () => {
  // A cube of 40 mm, counter-clockwise seen from outside: its corners have triangles of unlike angles.
  const cube = {
    vertices_mm: new Float32Array([-20, 20].flatMap((z) => [-20, -20, z, 20, -20, z, 20, 20, z, -20, 20, z])),
    triangles: new Uint32Array(
      [
        [0, 2, 1, 0, 3, 2],
        [4, 5, 6, 4, 6, 7],
        [0, 1, 5, 0, 5, 4],
        [1, 2, 6, 1, 6, 5],
        [2, 3, 7, 2, 7, 6],
        [3, 0, 4, 3, 4, 7],
      ].flat(),
    ),
  };
  const skin = new SkinDistance(cube);
  const random = new Random(4);
  let inside = 0;
  for (let k = 0; k < 2000; ++k) {
    // A third of the points is nearest to an edge or a corner.
    const p: Vec3 = [random.between(-32, 32), random.between(-32, 32), random.between(-32, 32)];
    const over = p.map((x) => Math.max(Math.abs(x) - 20, 0));
    const deep = 20 - Math.max(...p.map(Math.abs));
    const expected = deep > 0 ? -deep : Math.hypot(...over);
    if (deep > 0) ++inside;
    assert.ok(Math.abs(skin.of(p) - expected) < 1e-6, `${p}: ${skin.of(p)}, expected ${expected}`);
  }
  assert.ok(inside > 300);
});

test("colours of distances: green on the skin, red outside, blue inside, grey where not known", () => {
  assert.equal(distanceColour(0), "hsl(130 90% 60%)");
  assert.equal(distanceColour(3), "hsl(0 90% 60%)");
  assert.equal(distanceColour(40), distanceColour(3));
  assert.equal(distanceColour(-3), "hsl(245 90% 60%)");
  for (const unknown of [Number.NaN, Number.POSITIVE_INFINITY]) assert.equal(distanceColour(unknown), kColours.unknown);
});

const kTurn = [0, -1, 0, 1, 0, 0, 0, 0, 1]; // a quarter turn about z
const kNone9 = new Array<number>(9).fill(Number.NaN);
const kNone3 = kNone9.slice(0, 3);
const registered = (change: Partial<RecordOf<"registration">>) =>
  record("registration", {
    reference: "RobotBase",
    status: RegistrationStatus.CANDIDATE,
    rotation: kTurn,
    translation_mm: [100, 0, 0],
    accepted_rotation: kNone9,
    accepted_translation_mm: kNone3,
    ...change,
  });
const scanned = (ordinal: number, position_mm: number[]) =>
  record("capture", { tool: "Range", ordinal, kind: CaptureKind.SURFACE, position_mm });
const accepted = {
  status: RegistrationStatus.ACCEPTED,
  accepted_rotation: kTurn,
  accepted_translation_mm: [100, 0, 0],
};

// A store that takes records, and points whose distance from the skin is their height; `asked` counts the distances.
function scanning() {
  const store = new Store();
  const captures = new Captures();
  const counter = { asked: 0 };
  captures.setSkin({
    of: (p) => {
      ++counter.asked;
      return p[2];
    },
  });
  let frame = 0;
  const take = (...records: TestRecord[]) => store.apply(decodeFrame(encodeFrame(++frame, 0, records)));
  return { store, captures, counter, take };
}

test("points of a scan are in their own frame until a registration places them", () => {
  const { store, captures, take } = scanning();
  take(scanned(0, [1, 2, -3]), record("capture", { tool: "Guide", ordinal: 0, kind: 1, position_mm: [9, 9, 9] }));
  const refused = registered({ status: RegistrationStatus.REFUSED }); // whatever pose it states
  for (const missing of [
    [],
    [refused],
    [registered({ status: RegistrationStatus.NONE })],
    [registered({ status: 77 })],
  ]) {
    take(...missing);
    assert.deepEqual(captures.update(store), { placedBy: null, points: [], unplaced: [[1, 2, -3]] });
  }
  take(registered({}));
  const placed = captures.update(store);
  assert.equal(placed.placedBy, "candidate");
  assert.deepEqual(placed.unplaced, []);
  assert.deepEqual(placed.points[0], { position: [98, 1, -3], kind: CaptureKind.SURFACE, distance_mm: -3 });
  assert.ok(Number.isNaN(placed.points[1].distance_mm), "a touch of a fiducial is not on the skin");
  take(registered(accepted));
  assert.equal(captures.update(store).placedBy, "accepted");
  // A later estimate does not move what the accepted registration has placed.
  take(registered({ ...accepted, translation_mm: [0, 0, 0] }));
  assert.deepEqual(captures.update(store).points[0].position, [98, 1, -3]);
  take(record("registration", { reference: "RobotBase" }, true));
  assert.equal(captures.update(store).placedBy, null, "the case was closed");
});

test("a point is measured once when it arrives, and again when another registration places it or it is another", () => {
  const { store, captures, counter, take } = scanning();
  take(registered({}));
  for (let k = 0; k < 5; ++k) {
    take(scanned(k, [k, 0, k]));
    captures.update(store);
    captures.update(store); // the next draw
    assert.equal(counter.asked, k + 1);
  }
  take(scanned(4, [4, 0, 4])); // the same again
  assert.equal(captures.update(store).points.length, 5);
  assert.equal(counter.asked, 5);
  take(registered({ translation_mm: [0, 0, 7] }));
  assert.deepEqual(
    captures.update(store).points.map((p) => p.distance_mm),
    [7, 8, 9, 10, 11],
  );
  assert.equal(counter.asked, 10);
  take(record("capture", { tool: "Range", ordinal: 4 }, true), scanned(0, [0, 0, 20]));
  assert.deepEqual(
    captures.update(store).points.map((p) => p.distance_mm),
    [27, 8, 9, 10],
  );
});

test("points without a registration are seen from where they spread most", () => {
  const points: Vec3[] = [
    [400, -100, 91],
    [500, -100, 88],
    [400, 100, 90],
  ];
  const { across, up, at } = insetOf(points, { x: 10, y: 20, width: 100, height: 100 });
  assert.deepEqual([across, up], [0, 1]);
  for (const { x, y } of at) assert.ok(x >= 20 && x <= 100 && y >= 30 && y <= 110, `${x} ${y}`);
  assert.ok(at[1].x > at[0].x && at[2].y < at[0].y);
  assert.equal(insetOf([[5, 5, 5]], { x: 0, y: 0, width: 10, height: 10 }).at[0].x, 5);
});

const kNothing = {
  hash: "",
  meshes: [],
  trajectories: [],
  targets: [],
  fiducials: [],
  brain_landmarks: [],
  tools: [],
};

const twoPlans = {
  ...kNothing,
  trajectories: [
    { name: "Frontal", entry_mm: [0, 0, 80], target_mm: [0, 0, 20] },
    { name: "Parietal", entry_mm: [40, 0, 80], target_mm: [10, 0, 20] },
  ],
  targets: [
    { name: "Cyst", position_mm: [0, 0, 20] },
    { name: "Deep", position_mm: [10, 0, 20] },
  ],
} as unknown as CaseData;

const planScene = (data: CaseData, ...tools: Partial<RecordOf<"tool">>[]) => {
  const store = new Store();
  store.apply(
    decodeFrame(
      encodeFrame(
        1,
        0,
        tools.map((tool) => record("tool", { ...liveTool(1000), ...tool })),
      ),
    ),
  );
  const captures = new Captures().update(store);
  return sceneOf({ data, store, gateway_ms: 1000, captures, trace: new TipTrace(), slice: null });
};

test("the plan is that of the tool that follows one, also while this tool is hidden", () => {
  const hidden = { trajectory: "Parietal", status: PoseStatus.TOOL_HIDDEN };
  for (const scene of [
    planScene(twoPlans, { trajectory: "Parietal" }),
    planScene(twoPlans, hidden),
    planScene(twoPlans, { tool: "Stylus", trajectory: "" }, hidden),
  ]) {
    assert.equal(scene.trajectory?.name, "Parietal");
    assert.deepEqual(
      scene.plans.map((plan) => plan.name),
      ["Parietal"],
    );
    assert.equal(scene.target?.name, "Deep");
  }
});

test("of several plans none is taken for the one that is followed, and all are drawn", () => {
  const scene = planScene(twoPlans, { trajectory: "" });
  assert.equal(scene.trajectory, null);
  assert.equal(scene.target, null);
  assert.equal(scene.plans.length, 2);
  const one = { ...twoPlans, trajectories: twoPlans.trajectories.slice(1) };
  assert.equal(planScene(one, { trajectory: "" }).trajectory?.name, "Parietal");
  assert.equal(planScene(one, { trajectory: "of another case" }).trajectory, null);
});

test("the trace is that of one tool in one state, and is not drawn without it", () => {
  const trace = new TipTrace();
  const tool = (name: string, verified: boolean, x: number) =>
    ({ name, verified, tip: [x, 0, 0] }) as unknown as SceneTool;
  trace.update(0, tool("Probe", false, 1));
  trace.update(100, tool("Probe", false, 2));
  assert.equal(trace.update(200, tool("Probe", false, 3)).length, 3);
  assert.deepEqual(trace.update(300, tool("Probe", true, 4)), [[4, 0, 0]]);
  assert.deepEqual(trace.update(400, null), []);
  assert.equal(trace.update(500, tool("Probe", true, 5)).length, 2);
  assert.equal(trace.update(5350, tool("Probe", true, 6)).length, 2);
  assert.deepEqual(trace.update(5400, tool("Stylus", true, 7)), [[7, 0, 0]]);
});

// A guide of 150 mm along the flange's z.
const robotCase = {
  ...kNothing,
  tools: [
    { name: "RobotBase", role: "reference", axis: [0, 0, 1], normal: [0, 0, 1], tip_mm: [0, 0, 0], markers_mm: [] },
    { name: "Guide", role: "pointer", axis: [0, 0, 1], normal: [0, 0, 1], tip_mm: [0, 0, 150], markers_mm: [] },
  ],
} as unknown as CaseData;

function robotScene(tool: Partial<RecordOf<"tool">>, registration: Partial<RecordOf<"registration">>, now_ms = 1000) {
  const store = new Store();
  const guide = {
    ...liveTool(1000),
    tool: "Guide",
    trajectory: "",
    source_kind: DeviceKind.ROBOT,
    rotation: [0, 0, 1, 1, 0, 0, 0, 1, 0], // z of the flange along x of Image
    tip_mm: [10, 20, 30],
  };
  store.apply(
    decodeFrame(
      encodeFrame(1, 0, [record("tool", { ...guide, ...tool }), registered({ ...accepted, ...registration })]),
    ),
  );
  const captures = new Captures().update(store);
  return sceneOf({ data: robotCase, store, gateway_ms: now_ms, captures, trace: new TipTrace(), slice: null });
}

test("the arm is drawn from the pose of the tool that it carries: its flange, and its base as it is registered", () => {
  const { arms, tools } = robotScene({}, {});
  assert.equal(arms.length, 1);
  assert.equal(arms[0].tool, tools[0]);
  assert.ok(arms[0].tool.verified);
  assert.deepEqual(arms[0].flange, [-140, 20, 30]);
  assert.deepEqual(arms[0].base, [100, 0, 0]);
  assert.deepEqual(tools[0].direction, [1, 0, 0]);
});

test("no arm that is old, and none that is not an arm's", () => {
  const kOld = liveTool(1000).valid_until_ms;
  assert.equal(robotScene({}, {}, kOld - 1).arms.length, 1);
  assert.equal(robotScene({}, {}, kOld).arms.length, 0);
  for (const status of [0, 3, 4, 5, 6, 7, 8, 9, 77]) {
    const { arms, tools } = robotScene({ status }, {});
    assert.deepEqual([arms.length, tools.length], [0, 0], `status ${status}`);
  }
  assert.equal(robotScene({ plausibility: 3 }, {}).arms.length, 0);
  assert.equal(robotScene({ tip_mm: [Number.NaN, 0, 0] }, {}).arms.length, 0);
  assert.equal(robotScene({ source_kind: DeviceKind.TRACKER }, {}).arms.length, 0);
  assert.equal(robotScene({ tool: "Drill" }, {}).arms.length, 0, "its flange is not known");
});

test("an arm that is not verified is drawn as such; its base only where the accepted registration is that of the base", () => {
  const [arm] = robotScene({ status: PoseStatus.UNVERIFIED }, {}).arms;
  assert.ok(!arm.tool.verified);
  for (const change of [{ accepted_rotation: kNone9, accepted_translation_mm: kNone3 }, { reference: "Reference" }]) {
    const [other] = robotScene({}, change).arms;
    assert.equal(other.base, null);
    assert.deepEqual(other.flange, [-140, 20, 30]);
  }
});

// The same beside a tracker: the tracker is 1 m along x of the base, and turned by kTurn against it.
const besideCase = {
  ...robotCase,
  tools: [
    { ...robotCase.tools[0], name: "Reference" },
    { ...robotCase.tools[1], carried: true },
    { ...robotCase.tools[1], name: "Stylus", carried: false },
  ],
  hand_eye: { tracker: "Tracker", T_base_tracker: [0, -1, 0, 1000, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] },
} as unknown as CaseData;

function besideScene(seen: Partial<RecordOf<"tracked_tool">> | null, tool: Partial<RecordOf<"tool">> = {}) {
  const store = new Store();
  const guide = {
    ...liveTool(1000),
    tool: "Guide",
    trajectory: "",
    source_kind: DeviceKind.TRACKER,
    source: "Tracker",
    rotation: [0, 0, 1, 1, 0, 0, 0, 1, 0],
    tip_mm: [10, 20, 30],
    ...tool,
  };
  const records: TestRecord[] = [record("tool", guide), registered({ ...accepted, reference: "Reference" })];
  const reference = {
    device: "Tracker",
    tool: "Reference",
    acquired_ms: 900,
    rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1],
    translation_mm: [0, 500, 0],
  };
  if (seen) records.push(record("tracked_tool", { ...reference, ...seen }));
  store.apply(decodeFrame(encodeFrame(1, 0, records)));
  const captures = new Captures().update(store);
  return sceneOf({ data: besideCase, store, gateway_ms: 1000, captures, trace: new TipTrace(), slice: null });
}

test("beside a tracker the arm is that of the tool it carries; its base follows the tracked reference", () => {
  const { arms } = besideScene({});
  assert.equal(arms.length, 1);
  assert.deepEqual(arms[0].flange, [-140, 20, 30]);
  // The base is at [0, 1000, 0] in the tracker, [0, 500, 0] in the reference.
  const turned = [kTurn[1] * 500 + 100, kTurn[4] * 500, kTurn[7] * 500];
  assert.ok(
    arms[0].base?.every((x, i) => Math.abs(x - turned[i]) < 1e-9),
    `${arms[0].base}`,
  );
  const moved = besideScene({ translation_mm: [0, 520, 0] }).arms[0].base;
  assert.ok(Math.abs(Math.hypot(...turned.map((x, i) => x - (moved ?? kNone3)[i])) - 20) < 1e-9, `${moved}`);
});

test("beside a tracker no base by an old or hidden reference, no arm of a tracked tool or of another tracker", () => {
  const hidden = { rotation: kNone9, translation_mm: kNone3 };
  for (const seen of [null, hidden, { acquired_ms: 1000 - kMaxLiveAge_ms - 1 }, { device: "Other" }]) {
    const { arms } = besideScene(seen);
    assert.deepEqual([arms.length, arms[0].base], [1, null]);
  }
  assert.equal(besideScene({}, { tool: "Stylus" }).arms.length, 0);
  assert.equal(besideScene({}, { source: "Other" }).arms.length, 0);
  for (const status of [0, 3, 5, 7, 8]) assert.equal(besideScene({}, { status }).arms.length, 0, `status ${status}`);
});

test("the region that was traced least is asked for, until each has its part", () => {
  const spread = (front: number, right: number, left: number, top: number): Vec3[] => [
    ...new Array<Vec3>(front).fill([1, 90, 3]),
    ...new Array<Vec3>(right).fill([80, 5, 3]),
    ...new Array<Vec3>(left).fill([-80, 5, 3]),
    ...new Array<Vec3>(top).fill([1, 5, 90]),
  ];
  assert.equal(leastCovered(coverageOf(spread(10, 10, 0, 10))), "on the left");
  assert.equal(leastCovered(coverageOf(spread(50, 20, 20, 0))), "on top");
  assert.equal(leastCovered(coverageOf(spread(30, 20, 20, 20))), null);
  assert.equal(leastCovered(coverageOf([])), "in front");
});

test("figures state what is not known, and no negative zero", () => {
  assert.equal(figure(Number.NaN, 1, "mm"), "–");
  assert.equal(figure(-0.01, 1), "0.0");
  assert.equal(figure(-3.27, 1, "mm"), "−3.3 mm");
});

test("the camera page says which way to move", () => {
  const tool = (x: number, y: number, z: number, change: Partial<RecordOf<"tracked_tool">> = {}) =>
    ({
      status: 1,
      translation_mm: [x, y, z],
      rotation: [1, 0, 0, 0, -1, 0, 0, 0, -1],
      ...change,
    }) as RecordOf<"tracked_tool">;
  const volume = {
    volume_near_mm: 1000,
    volume_far_mm: 3000,
    volume_half_width_rad: 0.5,
    volume_half_height_rad: 0.25,
  };
  const said = (t: RecordOf<"tracked_tool">, normal: Vec3 | null = [0, 0, 1]) => advice(t, normal, volume);
  assert.match(said(tool(0, 0, 1040)), /away from the camera/);
  assert.match(said(tool(0, 0, 2960)), /towards the camera/);
  assert.match(said(tool(1000, 0, 2000)), /sideways/);
  assert.match(said(tool(0, -480, 2000)), /up or down/);
  assert.match(said(tool(0, 0, 1700), [0, 0, -1]), /Turn its markers to the camera \(180 °\)/);
  assert.match(said(tool(0, 0, 1700, { status: 2 })), /marker is covered/);
  assert.match(said(tool(0, 0, 1700)), /1.70 m away/);
  assert.match(said(tool(Number.NaN, 0, 0, { status: 3 }), null), /Clear the view/);
  assert.match(advice(tool(1000, 0, 900), [0, 0, 1], null), /1.35 m away|Turn/, "no volume is stated");
  assert.equal(volumeText(volume), "Working volume: 1.00 to 3.00 m, 57° wide, 29° high.");
  assert.match(volumeText(null), /not stated/);
});

test("the robot's tip in the scanner is stated only while its pose may be shown", () => {
  const tool = (change: Partial<RecordOf<"robot_tool">>) =>
    ({
      device: "Arm",
      tool: "Guide",
      scanner_status: 1,
      valid_until_ms: 1000,
      scanner_tip_mm: [1, -2, 30],
      scanner_error_95_mm: 0.71,
      ...change,
    }) as unknown as RecordOf<"robot_tool">;
  assert.match(tipText(tool({}), 999), /^Guide: 1\.0 +.2\.0 +30\.0 mm, error 0\.7 mm \(95 %\)$/);
  assert.equal(tipText(tool({}), 1000), "Guide: pose too old");
  assert.equal(tipText(tool({ valid_until_ms: Number.NaN }), 0), "Guide: pose too old");
  assert.equal(tipText(tool({ scanner_status: 8, tool: "" }), 0), "Arm: not registered to the scanner");
});

test("a registration of the scanner is valid only if the daemon says so", () => {
  const scanner = (change: Partial<RecordOf<"scanner">>) =>
    ({ validity: 2, validity_text: "", accepted_tre_95_mm: 0.314, ...change }) as unknown as RecordOf<"scanner">;
  assert.equal(validityText(scanner({})), "valid, predicted error at the target 0.31 mm (95 %)");
  assert.equal(
    validityText(scanner({ validity: 3, validity_text: "the table moved by 12.00 mm" })),
    "void: the table moved (the table moved by 12.00 mm)",
  );
  assert.match(validityText(scanner({ validity: 0 })), /not current/);
  assert.match(validityText(scanner({ validity: 77 })), /unknown/);
});
