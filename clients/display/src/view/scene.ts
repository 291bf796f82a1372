// What is drawn besides the image: from the states of the daemon, once per draw, the same for all panels.
import type { Ellipsoid } from "../geometry/ellipsoid.ts";
import { add, multiply, scale, sub, unit, type Vec3 } from "../geometry/vector.ts";
import type { CaseData, Trajectory } from "../state/case_data.ts";
import { CaptureKind, DeformationStatus, DeviceKind, kRobotBase } from "../state/constants.ts";
import type { Store } from "../state/store.ts";
import { type ShownTool, shownTool } from "../state/validity.ts";
import type { PlacedCaptures } from "./captures.ts";
import { kColours } from "./colours.ts";
import type { ScannerSlice } from "./scanner_slice.ts";
import type { Followed } from "./view_state.ts";

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
  readonly base: Vec3 | null; // null: the registration is not that of the arm's base
}

export interface Scene {
  readonly tools: readonly SceneTool[];
  readonly followed: Followed;
  readonly followedTool: SceneTool | null;
  readonly trajectory: Trajectory | null;
  readonly points: readonly ScenePoint[];
  readonly fiducials: readonly SceneFiducial[];
  readonly captures: readonly SceneCapture[];
  readonly placedBy: PlacedCaptures["placedBy"];
  readonly unplaced: readonly Vec3[]; // points of the skin that no registration places in Image, in Reference
  readonly reference: string; // name of that frame
  readonly arms: readonly SceneArm[];
  readonly trace: readonly Vec3[];
  readonly slice: ScannerSlice | null; // the scanner's latest
}

export interface SceneInput {
  readonly data: CaseData;
  readonly store: Store;
  readonly gateway_ms: number;
  readonly followedName: string | null; // tool that the viewer chose
  readonly captures: PlacedCaptures;
  readonly trace: readonly Vec3[];
  readonly slice: ScannerSlice | null;
}

export function sceneOf(input: SceneInput): Scene {
  const { data, store, gateway_ms } = input;
  const tools = store
    .all("tool")
    .map((state) => shownTool(state, gateway_ms))
    .filter((shown) => shown !== null)
    .map((shown) => sceneTool(shown, data));
  const followedTool = choose(tools, input.followedName);
  const trajectory = trajectoryOf(data, followedTool, store);
  const line = followedTool ? { tip: followedTool.tip, direction: followedTool.direction } : null;
  return {
    tools,
    followedTool,
    followed: { line, trajectory },
    trajectory,
    points: pointsOf(data, store),
    fiducials: data.fiducials.map((f) => {
      const report = store.get("fiducial", f.name);
      const residual = report && Number.isFinite(report.norm_mm) ? (report.residual_mm as unknown as Vec3) : null;
      return { name: f.name, position: f.position_mm, residual_mm: residual, suspect: report?.suspect === 1 };
    }),
    captures: input.captures.points,
    placedBy: input.captures.placedBy,
    unplaced: input.captures.unplaced,
    reference: data.tools.find((t) => t.role === "reference")?.name ?? "",
    arms: tools.map((tool) => armOf(tool, data, store)).filter((arm) => arm !== null),
    trace: input.trace,
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

// From the tool's pose and calibration alone: the arm's joints are not sent to displays.
function armOf(tool: SceneTool, data: CaseData, store: Store): SceneArm | null {
  const calibration = data.tools.find((t) => t.name === tool.name);
  if (tool.shown.state.source_kind !== DeviceKind.ROBOT || !calibration) return null;
  const flange = sub(tool.tip, multiply(tool.shown.rotation, calibration.tip_mm));
  const registration = store.get("registration", kRobotBase);
  const base = registration?.accepted_translation_mm.every(Number.isFinite)
    ? (registration.accepted_translation_mm as unknown as Vec3)
    : null;
  return { tool, flange, base };
}

// The viewer's choice, else the tool on a plan, else the first.
function choose(tools: readonly SceneTool[], name: string | null): SceneTool | null {
  return tools.find((t) => t.name === name) ?? tools.find((t) => t.shown.state.trajectory !== "") ?? tools[0] ?? null;
}

// The plan that a tool follows; without one the only plan of the case.
function trajectoryOf(data: CaseData, tool: SceneTool | null, store: Store): Trajectory | null {
  const named = tool?.shown.state.trajectory || store.all("tool").find((t) => t.trajectory !== "")?.trajectory;
  return data.trajectories.find((t) => t.name === named) ?? data.trajectories[0] ?? null;
}

function pointsOf(data: CaseData, store: Store): ScenePoint[] {
  return [...data.targets, ...data.brain_landmarks].map(({ name, position_mm }) => {
    const state = store.get("deformation", name);
    const valid = state?.status === DeformationStatus.VALID || state?.status === DeformationStatus.EXTRAPOLATING;
    const predicted =
      valid && state.displaced_mm.every(Number.isFinite) ? (state.displaced_mm as unknown as Vec3) : null;
    return { name, position: position_mm, predicted, bound_mm: valid ? state.error_bound_mm : Number.NaN };
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
