// The one rule for what may be drawn of a tool (docs/live.md, idl/validity.hpp): a pose that is live or unverified, whose
// data are plausible and finite, until the time over which it may be shown is over.
import { type Ellipsoid, type Growth, grown } from "../geometry/ellipsoid.ts";
import type { Mat3, Vec3 } from "../geometry/vector.ts";
import { Plausibility, PoseStatus } from "./constants.ts";
import type { RecordOf } from "./layout.ts";

export type Tool = RecordOf<"tool">;

// No pose is older than this, whatever a daemon or gateway states.
export const kMaxLiveAge_ms = 300;

export interface ShownTool {
  readonly name: string;
  readonly verified: boolean; // false: to be drawn as unverified
  readonly tip_mm: Vec3;
  readonly rotation: Mat3; // T_image_tip
  readonly region_95: Ellipsoid; // now: grown since the publication
  readonly age_ms: number;
  readonly state: Tool;
}

// False for a status without a pose, for implausible data, and for a pose or an error that is not finite.
export function hasPose(tool: Tool): boolean {
  const shown = tool.status === PoseStatus.LIVE || tool.status === PoseStatus.UNVERIFIED;
  const plausible =
    tool.plausibility === Plausibility.UNKNOWN ||
    tool.plausibility === Plausibility.GOOD ||
    tool.plausibility === Plausibility.INFLATED;
  return (
    shown &&
    plausible &&
    allFinite(tool.rotation) &&
    allFinite(tool.tip_mm) &&
    Number.isFinite(tool.tre_rms_mm) &&
    allFinite(tool.tre_95_semi_axes_mm)
  );
}

// Time for which the tool may still be drawn, by the gateway's clock; 0: it must not be.
export function remaining_ms(tool: Tool, now_ms: number): number {
  if (!hasPose(tool)) return 0;
  const age_ms = now_ms - tool.acquired_ms;
  const left_ms = Math.min(tool.valid_until_ms - now_ms, kMaxLiveAge_ms - age_ms);
  return Number.isNaN(left_ms) ? 0 : Math.max(0, left_ms);
}

// What is drawn of a tool at `now_ms` of the gateway's clock; null: nothing. now_ms is NaN while that clock is not known.
export function shownTool(tool: Tool, now_ms: number): ShownTool | null {
  if (!(remaining_ms(tool, now_ms) > 0)) return null;
  const published: Ellipsoid = {
    semi_axes_mm: tool.tre_95_semi_axes_mm as unknown as Vec3,
    axes: tool.tre_95_axes as unknown as Mat3,
  };
  const growth: Growth = {
    position_velocity_covariance_mm2_s: tool.position_velocity_covariance_mm2_s as unknown as Mat3,
    velocity_covariance_mm2_s2: tool.velocity_covariance_mm2_s2 as unknown as Mat3,
    acceleration_sigma_mm_s2: tool.acceleration_sigma_mm_s2,
  };
  return {
    name: tool.tool,
    verified: tool.status === PoseStatus.LIVE,
    tip_mm: tool.tip_mm as unknown as Vec3,
    rotation: tool.rotation as unknown as Mat3,
    region_95: grown(published, growth, (now_ms - tool.published_ms) / 1000),
    age_ms: now_ms - tool.acquired_ms,
    state: tool,
  };
}

function allFinite(values: readonly number[]): boolean {
  for (const value of values) if (!Number.isFinite(value)) return false;
  return true;
}
