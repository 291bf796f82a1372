// What is drawn besides the image: from the states of the daemon, once per draw, the same for all panels.
import type { Ellipsoid } from "../geometry/ellipsoid.ts";
import { add, distance, inRigid, type Mat3, multiply, scale, sub, unit, type Vec3 } from "../geometry/vector.ts";
import type { CaseData, CaseHandEye, Trajectory } from "../state/case_data.ts";
import { CaptureKind, DeformationStatus, DeviceKind, kRobotBase } from "../state/constants.ts";
import type { Store } from "../state/store.ts";
import { kMaxLiveAge_ms, type ShownTool, shownTool } from "../state/validity.ts";
import type { PlacedCaptures } from "./captures.ts";
import { kColours } from "./colours.ts";
import type { ScannerSlice } from "./scanner_slice.ts";
import type { TipTrace } from "./tip_trace.ts";
import type { Followed } from "./view_state.ts";

const kSamePoint_mm = 1; // a plan that ends this close to a target leads to it

export interface SceneTool {
  readonly name: string;
  readonly verified: boolean;
  readonly tip: Vec3;
  readonly direction: Vec3; // unit, towards the tip and beyond
  readonly region_95: Ellipsoid;
  readonly shown: ShownTool;
}

export interface ScenePoint {
  readonly name: string;
  readonly position: Vec3;
  readonly predicted: Vec3 | null; // where the tissue model has it
  readonly bound_mm: number; // of the prediction
  readonly extrapolated: boolean; // such as from the last pose of a probe that is hidden
}

export interface SceneFiducial {
  readonly name: string;
  readonly position: Vec3;
  readonly residual_mm: Vec3 | null; // registered minus planned
  readonly suspect: boolean;
}

export interface SceneCapture {
  readonly position: Vec3; // Image, by the latest registration
  readonly kind: number;
  readonly distance_mm: number; // from the skin, positive outside; NaN: not computed
}

// The arm that carries a tool, in Image. It is as live as that tool, and is drawn as it: its pose is all that is known.
export interface SceneArm {
  readonly tool: SceneTool;
  readonly flange: Vec3;
  readonly base: Vec3 | null; // null: not known
}

export interface Scene {
  readonly tools: readonly SceneTool[];
  readonly followed: Followed;
  readonly followedTool: SceneTool | null;
  readonly trajectory: Trajectory | null; // the plan that is followed
  readonly plans: readonly Trajectory[]; // to be drawn: that one, or all of the case while none is followed
  readonly points: readonly ScenePoint[];
  readonly target: ScenePoint | null; // of the plan that is followed
  readonly fiducials: readonly SceneFiducial[];
  readonly captures: readonly SceneCapture[];
  readonly placedBy: PlacedCaptures["placedBy"];
  readonly unplaced: readonly Vec3[]; // points of the skin that no registration places in Image, in Reference
  readonly reference: string; // name of that frame
  readonly arms: readonly SceneArm[];
  readonly trace: readonly Vec3[]; // of followedTool
  readonly slice: ScannerSlice | null; // the scanner's latest
}

export interface SceneInput {
  readonly data: CaseData;
  readonly store: Store;
  readonly gateway_ms: number;
  readonly captures: PlacedCaptures;
  readonly trace: TipTrace;
  readonly slice: ScannerSlice | null;
}

export function sceneOf(input: SceneInput): Scene {
  const { data, store, gateway_ms } = input;
  const tools = store
    .all("tool")
    .map((state) => shownTool(state, gateway_ms))
    .filter((shown) => shown !== null)
    .map((shown) => sceneTool(shown, data));
  const followedTool = choose(tools);
  const trajectory = trajectoryOf(data, followedTool, store);
  const points = pointsOf(data, store);
  const line = followedTool ? { tip: followedTool.tip, direction: followedTool.direction } : null;
  return {
    tools,
    followedTool,
    followed: { line, trajectory },
    trajectory,
    plans: trajectory ? [trajectory] : data.trajectories,
    points,
    target: points.find((p) => trajectory && distance(p.position, trajectory.target_mm) < kSamePoint_mm) ?? null,
    fiducials: data.fiducials.map((f) => {
      const report = store.get("fiducial", f.name);
      const residual = report && Number.isFinite(report.norm_mm) ? (report.residual_mm as unknown as Vec3) : null;
      return { name: f.name, position: f.position_mm, residual_mm: residual, suspect: report?.suspect === 1 };
    }),
    captures: input.captures.points,
    placedBy: input.captures.placedBy,
    unplaced: input.captures.unplaced,
    reference: data.tools.find((t) => t.role === "reference")?.name ?? "",
    arms: tools.map((tool) => armOf(tool, data, store, gateway_ms)).filter((arm) => arm !== null),
    trace: input.trace.update(gateway_ms, followedTool),
    slice: input.slice,
  };
}

function sceneTool(shown: ShownTool, data: CaseData): SceneTool {
  const axis = data.tools.find((t) => t.name === shown.name)?.axis ?? [-1, 0, 0];
  const direction = unit(multiply(shown.rotation, axis));
  return {
    name: shown.name,
    verified: shown.verified,
    tip: shown.tip_mm,
    direction,
    region_95: shown.region_95,
    shown,
  };
}

// From the tool's pose and calibration alone: the arm's joints are not sent to displays. Beside a tracker the tool that
// the arm carries has a pose of the tracker's kind.
function armOf(tool: SceneTool, data: CaseData, store: Store, gateway_ms: number): SceneArm | null {
  const calibration = data.tools.find((t) => t.name === tool.name);
  if (!calibration) return null;
  const alone = tool.shown.state.source_kind === DeviceKind.ROBOT;
  const beside = data.hand_eye && calibration.carried && tool.shown.state.source === data.hand_eye.tracker;
  if (!alone && !beside) return null;
  const flange = sub(tool.tip, multiply(tool.shown.rotation, calibration.tip_mm));
  return { tool, flange, base: alone ? baseAlone(store) : baseBeside(data, store, gateway_ms) };
}

// Where the accepted registration is that of the base.
function baseAlone(store: Store): Vec3 | null {
  const registration = store.get("registration", kRobotBase);
  return registration?.accepted_translation_mm.every(Number.isFinite)
    ? (registration.accepted_translation_mm as unknown as Vec3)
    : null;
}

// T_image_reference (T_tracker_reference)^-1 (T_base_tracker)^-1, applied to the base's origin, while the tracker sees
// the reference: never by an older pose of it than one that may be shown.
function baseBeside(data: CaseData, store: Store, gateway_ms: number): Vec3 | null {
  const handEye = data.hand_eye as CaseHandEye;
  const reference = data.tools.find((t) => t.role === "reference")?.name ?? "";
  const registration = store.get("registration", reference);
  const seen = store.get("tracked_tool", handEye.tracker, reference);
  if (!registration || !seen || !(gateway_ms - seen.acquired_ms <= kMaxLiveAge_ms)) return null;
  const [R, t] = [seen.rotation, seen.translation_mm];
  const T_tracker_reference = [R[0], R[1], R[2], t[0], R[3], R[4], R[5], t[1], R[6], R[7], R[8], t[2]];
  const inReference = inRigid(T_tracker_reference, inRigid(handEye.T_base_tracker, [0, 0, 0]));
  const base = add(
    multiply(registration.accepted_rotation as unknown as Mat3, inReference),
    registration.accepted_translation_mm as unknown as Vec3,
  );
  return base.every(Number.isFinite) ? base : null;
}

// The tool on a plan, else the first.
function choose(tools: readonly SceneTool[]): SceneTool | null {
  return tools.find((t) => t.shown.state.trajectory !== "") ?? tools[0] ?? null;
}

// The plan that a tool follows, also while that tool is hidden; without one the only plan of the case. Of several plans
// none is taken for the one that is followed.
function trajectoryOf(data: CaseData, tool: SceneTool | null, store: Store): Trajectory | null {
  const named = tool?.shown.state.trajectory || store.all("tool").find((t) => t.trajectory !== "")?.trajectory;
  if (named) return data.trajectories.find((t) => t.name === named) ?? null;
  return data.trajectories.length === 1 ? data.trajectories[0] : null;
}

function pointsOf(data: CaseData, store: Store): ScenePoint[] {
  return [...data.targets, ...data.brain_landmarks].map(({ name, position_mm }) => {
    const state = store.get("deformation", name);
    const extrapolated = state?.status === DeformationStatus.EXTRAPOLATING;
    const valid = state?.status === DeformationStatus.VALID || extrapolated;
    const predicted =
      valid && state.displaced_mm.every(Number.isFinite) ? (state.displaced_mm as unknown as Vec3) : null;
    return {
      name,
      position: position_mm,
      predicted,
      bound_mm: valid ? state.error_bound_mm : Number.NaN,
      extrapolated,
    };
  });
}

export const isSurface = (c: { kind: number }): boolean => c.kind === CaptureKind.SURFACE;

// Of a signed distance: green on the skin; outside it yellow at 1 mm and red from 3 mm on, inside it turquoise and blue.
export const kFar_mm = 3;
export function distanceColour(distance_mm: number): string {
  if (!Number.isFinite(distance_mm)) return kColours.unknown;
  const t = Math.min(Math.abs(distance_mm) / kFar_mm, 1);
  return `hsl(${Math.round(130 + (distance_mm < 0 ? 115 : -130) * t)} 90% 60%)`;
}

export const tipAhead = (tool: SceneTool, mm: number): Vec3 => add(tool.tip, scale(tool.direction, mm));
