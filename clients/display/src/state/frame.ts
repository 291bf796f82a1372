// Decoder of the binary frames of /state (docs/gateway.md).
import { type FieldType, kLayouts, type RecordName, type RecordOf } from "./layout.ts";

export const kMagic = 0x46475242;
export const kLayoutVersion = 4;
export const kHeaderBytes = 24;
const kRecordHeaderBytes = 8;
const kFlagEnded = 1;
const kFieldRecordBytes = 64; // of a record `field` before its arrays
const kSliceRecordBytes = 456; // of a record `slice` before its pixels

// Displacements and stresses at the nodes of the tissue mesh, behind the fields of a record `field`.
export interface FieldArrays {
  readonly displacement_mm: Float32Array;
  readonly von_mises_Pa: Float32Array; // empty: not stated
}

export interface DecodedRecord<N extends RecordName = RecordName> {
  readonly name: N;
  readonly ended: boolean;
  readonly key: string;
  readonly value: RecordOf<N>;
  readonly arrays?: FieldArrays;
  readonly pixels?: Uint16Array; // of a slice, row by row
}

export interface Frame {
  readonly number: number;
  readonly written_ms: number; // gateway clock
  readonly records: readonly DecodedRecord[];
}

type FieldReader = (view: DataView, start: number) => unknown;

interface CompiledLayout {
  readonly name: RecordName;
  readonly bytes: number; // of the known fields, record header included
  readonly keys: readonly string[];
  readonly fields: readonly (readonly [string, FieldReader])[];
}

// Throws an Error with a sentence for a frame that does not follow the contract. Records of unknown kinds, and bytes
// beyond the known fields, are skipped.
export function decodeFrame(buffer: ArrayBuffer): Frame {
  const view = new DataView(buffer);
  if (buffer.byteLength < kHeaderBytes) throw new Error(`frame of ${buffer.byteLength} bytes: shorter than its header`);
  const magic = view.getUint32(0, true);
  if (magic !== kMagic) throw new Error(`frame begins with 0x${magic.toString(16)}: not a frame of bregma-gateway`);
  const layout = view.getUint16(4, true);
  if (layout < kLayoutVersion) throw new Error(`frame of layout ${layout}: this page needs ${kLayoutVersion}`);
  const stated = view.getUint32(12, true);
  if (stated !== buffer.byteLength) throw new Error(`frame of ${buffer.byteLength} bytes states ${stated}`);
  const count = view.getUint16(6, true);
  const records: DecodedRecord[] = [];
  let offset = kHeaderBytes;
  for (let i = 0; i < count; ++i) {
    if (offset + kRecordHeaderBytes > buffer.byteLength) throw new Error(`record ${i} begins beyond the frame`);
    const bytes = view.getUint32(offset + 4, true);
    if (bytes < kRecordHeaderBytes || bytes % 8 !== 0 || offset + bytes > buffer.byteLength) {
      throw new Error(`record ${i} states ${bytes} bytes at ${offset} of ${buffer.byteLength}`);
    }
    const record = decodeRecord(view, offset, bytes);
    if (record) records.push(record);
    offset += bytes;
  }
  return { number: view.getUint32(8, true), written_ms: view.getFloat64(16, true), records };
}

function decodeRecord(view: DataView, start: number, bytes: number): DecodedRecord | null {
  const layout = byKind.get(view.getUint16(start, true));
  if (!layout) return null;
  if (bytes < layout.bytes) throw new Error(`record ${layout.name} of ${bytes} bytes: needs ${layout.bytes}`);
  const value: Record<string, unknown> = {};
  for (const [name, read] of layout.fields) value[name] = read(view, start);
  const key = layout.keys.map((name) => String(value[name])).join("\n");
  const ended = (view.getUint16(start + 2, true) & kFlagEnded) !== 0;
  const record = { name: layout.name, ended, key, value: value as RecordOf<RecordName> };
  if (ended) return record;
  if (layout.name === "field") return { ...record, arrays: decodeArrays(view, start, bytes) };
  if (layout.name === "slice") return { ...record, pixels: decodePixels(view, start, bytes) };
  return record;
}

function decodePixels(view: DataView, start: number, bytes: number): Uint16Array {
  const columns = view.getUint32(start + kLayouts.slice.fields.columns[0], true);
  const rows = view.getUint32(start + kLayouts.slice.fields.rows[0], true);
  if (kSliceRecordBytes + 2 * columns * rows > bytes) {
    throw new Error(`record slice of ${bytes} bytes states ${columns} x ${rows} pixels`);
  }
  const at = view.byteOffset + start + kSliceRecordBytes;
  return new Uint16Array(view.buffer as ArrayBuffer, at, columns * rows).slice();
}

function decodeArrays(view: DataView, start: number, bytes: number): FieldArrays {
  const nodes = view.getUint32(start + 52, true);
  const stresses = view.getUint32(start + 56, true);
  if (kFieldRecordBytes + 4 * (3 * nodes + stresses) > bytes) {
    throw new Error(`record field of ${bytes} bytes states ${nodes} nodes and ${stresses} stresses`);
  }
  // Copies: the records of a frame begin at multiples of 8, so that the views are aligned.
  const at = view.byteOffset + start + kFieldRecordBytes;
  return {
    displacement_mm: new Float32Array(view.buffer as ArrayBuffer, at, 3 * nodes).slice(),
    von_mises_Pa: new Float32Array(view.buffer as ArrayBuffer, at + 12 * nodes, stresses).slice(),
  };
}

function compile(name: RecordName): CompiledLayout {
  const { keys, fields } = kLayouts[name];
  const compiled: [string, FieldReader][] = [];
  let end = kRecordHeaderBytes;
  for (const [field, [offset, type]] of Object.entries(fields)) {
    compiled.push([field, reader(offset, type)]);
    end = Math.max(end, offset + sizeOf(type));
  }
  return { name, bytes: end, keys, fields: compiled };
}

// The number in brackets of an array type.
const lengthOf = (type: FieldType): number => Number(/\[(\d+)\]/.exec(type)?.[1] ?? 1);

export function sizeOf(type: FieldType): number {
  if (type.startsWith("char")) return lengthOf(type);
  return type.startsWith("f64") ? 8 * lengthOf(type) : 4;
}

const utf8 = new TextDecoder();

function reader(offset: number, type: FieldType): FieldReader {
  const length = lengthOf(type);
  if (type.startsWith("char")) return (view, start) => readText(view, start + offset, length);
  if (type === "i32") return (view, start) => view.getInt32(start + offset, true);
  if (type === "u32") return (view, start) => view.getUint32(start + offset, true);
  if (type === "f64") return (view, start) => view.getFloat64(start + offset, true);
  return (view, start) => {
    const values = new Array<number>(length);
    for (let i = 0; i < length; ++i) values[i] = view.getFloat64(start + offset + 8 * i, true);
    return values;
  };
}

function readText(view: DataView, start: number, length: number): string {
  let end = 0;
  while (end < length && view.getUint8(start + end) !== 0) ++end;
  return end === 0 ? "" : utf8.decode(new Uint8Array(view.buffer as ArrayBuffer, view.byteOffset + start, end));
}

const byKind = new Map<number, CompiledLayout>(
  (Object.keys(kLayouts) as RecordName[]).map((name) => [kLayouts[name].kind, compile(name)]),
);
