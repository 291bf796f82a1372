// The latest corrected slice of a scanner, as an image of one slice with a plane of its own.
//
// If the scanner is registered to the case's image, the slice lies in it, and everything that is drawn over a plane is
// drawn over this one. Otherwise positions are those of the slice: x along a row, y against the columns' direction.

import type { Plane } from "../geometry/planes.ts";
import { cross, scale, type Vec3 } from "../geometry/vector.ts";
import type { Volume, Window } from "../image/volume.ts";
import type { RecordOf } from "../state/layout.ts";
import type { Store } from "../state/store.ts";

export interface ScannerSlice {
  readonly record: RecordOf<"slice">;
  readonly volume: Volume;
  readonly plane: Plane; // its centre is that of the slice; rows run to the right, columns downwards
  readonly registered: boolean; // positions are in Image
  readonly window: Window;
  readonly age_ms: number; // since the daemon published it; NaN: not known
  readonly tip: SliceTip | null;
}

// The robot's tip, while it may be drawn. Positions in the frame of the plane.
export interface SliceTip {
  readonly foot: Vec3; // nearest point of the plane
  readonly direction: Vec3;
  readonly distance_mm: number; // from the plane
  readonly error_95_mm: number;
}

const kLive = 1; // PoseStatus
const kMaxTipAge_ms = 300;
const kThin_mm = 1; // of a slice that does not state its thickness

type StillSlice = Omit<ScannerSlice, "age_ms" | "tip">;

export class ScannerSlices {
  private key = "";
  private still: StillSlice | null = null;

  // The slice of the scanner that is listed first.
  update(store: Store, gateway_ms: number): ScannerSlice | null {
    const record = store.all("slice")[0];
    const pixels = record ? store.pixelsOf(record.device) : null;
    if (!record || !pixels || pixels.length === 0) {
      this.key = "";
      this.still = null;
      return null;
    }
    const key = `${record.device} ${store.revision("slice")}`;
    if (key !== this.key || !this.still) {
      this.key = key;
      this.still = sliceOf(record, pixels);
    }
    return { ...this.still, age_ms: gateway_ms - record.published_ms, tip: tipOf(this.still, gateway_ms) };
  }
}

function sliceOf(record: RecordOf<"slice">, pixels: Uint16Array): StillSlice {
  const R = record.image_rotation;
  const registered = [...R, ...record.image_translation_mm].every(Number.isFinite);
  const column = (c: number): Vec3 => [R[c], R[3 + c], R[6 + c]];
  const right: Vec3 = registered ? column(0) : [1, 0, 0];
  const down: Vec3 = registered ? column(1) : [0, -1, 0];
  const normal = cross(right, down);
  const origin: Vec3 = registered ? (record.image_translation_mm as unknown as Vec3) : [0, 0, 0];
  const [across, along] = record.spacing_mm;
  const axes = [scale(right, across), scale(down, along), scale(normal, record.thickness_mm || kThin_mm)];
  const T = [0, 1, 2].flatMap((r) => [axes[0][r], axes[1][r], axes[2][r], origin[r]]);
  const half = [(record.columns - 1) / 2, (record.rows - 1) / 2];
  const centre = [0, 1, 2].map((r) => origin[r] + axes[0][r] * half[0] + axes[1][r] * half[1]) as unknown as Vec3;
  return {
    record,
    volume: { size: [record.columns, record.rows, 1], T_image_index: T, voxels: pixels },
    plane: { centre, right, up: scale(down, -1) },
    registered,
    window: windowOf(pixels),
  };
}

// From the 1st to the 99th percentile: a scanner's grey values have no unit.
export function windowOf(pixels: Uint16Array): Window {
  const counts = new Uint32Array(65536);
  for (const value of pixels) ++counts[value];
  const at = (fraction: number): number => {
    let left = fraction * (pixels.length - 1);
    for (let value = 0; value < counts.length; ++value) {
      left -= counts[value];
      if (left < 0) return value;
    }
    return 65535;
  };
  const [low, high] = [at(0.01), at(0.99)];
  return { window: Math.max(high - low, 1), level: (low + high) / 2 };
}

function tipOf({ record, plane, volume }: StillSlice, gateway_ms: number): SliceTip | null {
  const { tip_status, tip_pixel, tip_direction, tip_distance_mm, tip_error_95_mm, published_ms } = record;
  const age_ms = gateway_ms - published_ms;
  if (tip_status !== kLive || !(age_ms <= kMaxTipAge_ms)) return null;
  if (![...tip_pixel, ...tip_direction, tip_distance_mm].every(Number.isFinite)) return null;
  const T = volume.T_image_index;
  const foot = [0, 1, 2].map((r) => T[4 * r] * tip_pixel[0] + T[4 * r + 1] * tip_pixel[1] + T[4 * r + 3]);
  const down = scale(plane.up, -1);
  const normal = cross(plane.right, down);
  const direction = [0, 1, 2].map(
    (r) => plane.right[r] * tip_direction[0] + down[r] * tip_direction[1] + normal[r] * tip_direction[2],
  );
  return {
    foot: foot as unknown as Vec3,
    direction: direction as unknown as Vec3,
    distance_mm: tip_distance_mm,
    error_95_mm: tip_error_95_mm,
  };
}
