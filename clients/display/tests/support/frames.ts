// Encoder of the frames of /state for tests: what a gateway writes.
import { kHeaderBytes, kLayoutVersion, kMagic, sizeOf } from "../../src/state/frame.ts";
import { kLayouts, type RecordName, type RecordOf } from "../../src/state/layout.ts";

export interface TestRecord<N extends RecordName = RecordName> {
  readonly name: N;
  readonly value: Partial<RecordOf<N>>;
  readonly ended?: boolean;
  readonly tail?: Uint8Array; // behind the fields, in whole multiples of 8 bytes
}

export const record = <N extends RecordName>(name: N, value: Partial<RecordOf<N>>, ended = false): TestRecord<N> => ({
  name,
  value,
  ended,
});

export function encodeFrame(number: number, written_ms: number, records: readonly TestRecord[]): ArrayBuffer {
  const sizes = records.map((r) => recordBytes(r.name) + (r.tail?.length ?? 0));
  const bytes = kHeaderBytes + sizes.reduce((sum, size) => sum + size, 0);
  const buffer = new ArrayBuffer(bytes);
  const view = new DataView(buffer);
  view.setUint32(0, kMagic, true);
  view.setUint16(4, kLayoutVersion, true);
  view.setUint16(6, records.length, true);
  view.setUint32(8, number, true);
  view.setUint32(12, bytes, true);
  view.setFloat64(16, written_ms, true);
  let offset = kHeaderBytes;
  records.forEach((r, i) => {
    encodeRecord(view, offset, r, sizes[i]);
    offset += sizes[i];
  });
  return buffer;
}

export function recordBytes(name: RecordName): number {
  let end = 8;
  for (const [offset, type] of Object.values(kLayouts[name].fields)) end = Math.max(end, offset + sizeOf(type));
  return Math.ceil(end / 8) * 8;
}

function encodeRecord(view: DataView, start: number, r: TestRecord, bytes: number): void {
  view.setUint16(start, kLayouts[r.name].kind, true);
  view.setUint16(start + 2, r.ended ? 1 : 0, true);
  view.setUint32(start + 4, bytes, true);
  for (const [field, [offset, type]] of Object.entries(kLayouts[r.name].fields)) {
    const value = (r.value as Record<string, unknown>)[field];
    const at = start + offset;
    if (type.startsWith("char")) {
      new Uint8Array(view.buffer, at, sizeOf(type)).set(new TextEncoder().encode((value as string) ?? ""));
    } else if (type === "i32") view.setInt32(at, (value as number) ?? 0, true);
    else if (type === "u32") view.setUint32(at, (value as number) ?? 0, true);
    else {
      const values = Array.isArray(value) ? value : [value ?? Number.NaN];
      for (let i = 0; i < sizeOf(type) / 8; ++i) view.setFloat64(at + 8 * i, (values[i] as number) ?? Number.NaN, true);
    }
  }
  if (r.tail) new Uint8Array(view.buffer, start + recordBytes(r.name)).set(r.tail);
}

// A live pose with everything stated.
export function liveTool(now_ms: number): RecordOf<"tool"> {
  const identity3 = [1, 0, 0, 0, 1, 0, 0, 0, 1];
  return {
    tool: "Probe",
    frame: 7,
    acquired_ms: now_ms - 8,
    published_ms: now_ms - 4,
    valid_until_ms: now_ms + 90,
    age_sigma_ms: 0.2,
    status: 1,
    session: 6,
    rotation: identity3,
    tip_mm: [1, 2, 3],
    velocity_mm_s: [0, 0, 0],
    covariance: new Array(36).fill(0.01),
    position_velocity_covariance_mm2_s: new Array(9).fill(0),
    velocity_covariance_mm2_s2: new Array(9).fill(0),
    acceleration_sigma_mm_s2: 100,
    tre_rms_mm: 0.5,
    tre_95_semi_axes_mm: [1.2, 0.9, 0.6],
    tre_95_axes: identity3,
    trajectory: "Frontal right",
    distance_to_target_mm: 20,
    lateral_deviation_mm: 0.4,
    angle_rad: 0.02,
    remaining_depth_mm: 20,
    predicted_target_mm: [0, 0, 0],
    distance_to_predicted_target_mm: 19,
    nearest_structure: "Ventricle",
    nearest_structure_mm: 6,
    nearest_structure_sigma_mm: 0.5,
    prediction: 2,
    plausibility: 1,
    plausibility_reason: 1,
    source_kind: 1,
    source: "tracker",
  };
}
