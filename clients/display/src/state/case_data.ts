// The loaded case, as the gateway serves it under /case (docs/gateway.md).
import { type Mesh, MeshCutter } from "../geometry/mesh_cut.ts";
import type { Vec3 } from "../geometry/vector.ts";
import { sampleNearest, type Volume, type Voxels, type Window } from "../image/volume.ts";
import type { Colour } from "../render/mesh_renderer.ts";

export type MeshKind = "scalp" | "brain" | "structure" | "tissue";

export interface CaseMesh {
  readonly name: string;
  readonly kind: MeshKind;
  readonly colour: Colour;
  readonly css: string; // the same colour
  readonly opacity: number;
  readonly mesh: Mesh;
  readonly cutter: MeshCutter;
}

export interface NamedPoint {
  readonly name: string;
  readonly position_mm: Vec3;
}

export interface Trajectory {
  readonly name: string;
  readonly entry_mm: Vec3;
  readonly target_mm: Vec3;
}

export interface CaseTool {
  readonly name: string;
  readonly role: "reference" | "pointer" | "probe";
  readonly axis: Vec3; // from the body towards the tip, in the body frame
  readonly normal: Vec3;
  readonly tip_mm: Vec3;
  readonly markers_mm: readonly Vec3[];
  readonly carried?: boolean; // by an arm: its body is the flange
}

// A tracker beside an arm, in the arm's base.
export interface CaseHandEye {
  readonly tracker: string;
  readonly T_base_tracker: readonly number[]; // 4 x 4, row by row
}

export interface CaseLabels {
  readonly volume: Volume;
  readonly names: ReadonlyMap<number, string>;
  readonly colours: ReadonlyMap<number, Colour>;
}

// Another image of the same head, registered to the case's.
export interface CaseImage {
  readonly name: string;
  readonly volume: Volume;
  readonly window: Window;
  readonly covariance: readonly number[]; // 6x6, row by row, of its registration: rotation (rad), translation (mm)
  readonly accepted: string; // why a person uses a registration that was not found to be good; empty: it was
  readonly T_image_source: readonly number[]; // 4 x 4, row by row: from its own coordinates to Image
}

export interface CaseData {
  readonly hash: string;
  readonly id: string;
  readonly side: string;
  readonly image: Volume;
  readonly presets: readonly WindowPreset[];
  readonly air: number; // values of the image up to this are taken for air, in the 3-D panel
  readonly labels: CaseLabels | null;
  readonly images: readonly CaseImage[];
  readonly meshes: readonly CaseMesh[];
  readonly trajectories: readonly Trajectory[];
  readonly targets: readonly NamedPoint[];
  readonly fiducials: readonly NamedPoint[];
  readonly landmarks: readonly NamedPoint[];
  readonly brain_landmarks: readonly NamedPoint[];
  readonly tools: readonly CaseTool[];
  readonly hand_eye?: CaseHandEye | null;
  readonly limits: Readonly<Record<string, number>>;
}

export interface WindowPreset extends Window {
  readonly name: string;
}

// What is drawn while no case is loaded: nothing but what a scanner sends.
export const kNoCase: CaseData = {
  hash: "",
  id: "",
  side: "",
  image: { size: [1, 1, 1], T_image_index: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], voxels: new Uint8Array(1) },
  presets: [{ name: "", window: 1, level: 0 }],
  air: 0,
  labels: null,
  images: [],
  meshes: [],
  trajectories: [],
  targets: [],
  fiducials: [],
  landmarks: [],
  brain_landmarks: [],
  tools: [],
  limits: {},
};

interface StatedVolume {
  readonly url: string;
  readonly type: keyof typeof kArrays;
  readonly dims: [number, number, number];
  readonly T_ras_voxel: number[];
}

interface StatedImage extends StatedVolume {
  readonly min: number;
  readonly max: number;
  readonly percentiles: [number, number][];
}

interface StatedMesh {
  readonly name: string;
  readonly kind: MeshKind;
  readonly colour: string;
  readonly opacity: number;
  readonly url: string;
}

interface StatedCase extends Omit<CaseData, "image" | "presets" | "air" | "labels" | "images" | "meshes"> {
  readonly image: StatedImage;
  readonly labels: (StatedVolume & { regions: { value: number; name: string; colour: string }[] }) | null;
  readonly images?: (StatedImage & Pick<CaseImage, "name" | "covariance" | "accepted" | "T_image_source">)[];
  readonly meshes: StatedMesh[];
}

const kArrays = { int16: Int16Array, uint16: Uint16Array, uint8: Uint8Array, float32: Float32Array } as const;

const kAir = 0.05; // of the image's range, above its smallest value

// Fetches everything. Throws an Error with a sentence.
export async function loadCase(base = ""): Promise<CaseData> {
  const stated = (await (await get(`${base}/case`)).json()) as StatedCase;
  const [image, labels, images, meshes] = await Promise.all([
    loadVolume(base, stated.image),
    stated.labels ? loadVolume(base, stated.labels) : null,
    Promise.all((stated.images ?? []).map((other) => loadVolume(base, other))),
    Promise.all(stated.meshes.map((mesh) => loadMesh(base, mesh))),
  ]);
  return {
    ...stated,
    image,
    presets: presetsOf(stated.image),
    air: stated.image.min + kAir * (stated.image.max - stated.image.min),
    labels: labels && stated.labels ? labelsOf(labels, stated.labels.regions) : null,
    images: (stated.images ?? []).map((other, i) => ({
      name: other.name,
      volume: images[i],
      window: presetsOf(other)[0],
      covariance: other.covariance,
      accepted: other.accepted,
      T_image_source: other.T_image_source,
    })),
    meshes,
  };
}

async function get(url: string): Promise<Response> {
  const response = await fetch(url);
  if (!response.ok) {
    const text = await response.text();
    let reason = text;
    try {
      reason = (JSON.parse(text) as { error: string }).error;
    } catch {} // not JSON: the text itself
    throw new Error(reason || `${url}: ${response.status}`);
  }
  return response;
}

async function loadVolume(base: string, stated: StatedVolume): Promise<Volume> {
  const data = await (await get(base + stated.url)).arrayBuffer();
  const [ni, nj, nk] = stated.dims;
  const bytes = ni * nj * nk * kArrays[stated.type].BYTES_PER_ELEMENT;
  if (data.byteLength !== bytes) throw new Error(`${stated.url}: ${data.byteLength} bytes instead of ${bytes}`);
  const voxels: Voxels = new kArrays[stated.type](data);
  return { size: stated.dims, T_image_index: stated.T_ras_voxel.slice(0, 12), voxels };
}

async function loadMesh(base: string, stated: StatedMesh): Promise<CaseMesh> {
  const data = await (await get(base + stated.url)).arrayBuffer();
  const [vertices, triangles] = new Uint32Array(data, 0, 2);
  if (data.byteLength !== 8 + 12 * (vertices + triangles)) throw new Error(`${stated.url}: its size is not as stated`);
  const mesh: Mesh = {
    vertices_mm: new Float32Array(data, 8, 3 * vertices),
    triangles: new Uint32Array(data, 8 + 12 * vertices, 3 * triangles),
  };
  const { name, kind, opacity } = stated;
  return {
    name,
    kind,
    opacity,
    css: stated.colour,
    colour: colourOf(stated.colour),
    mesh,
    cutter: new MeshCutter(mesh),
  };
}

function labelsOf(volume: Volume, regions: { value: number; name: string; colour: string }[]): CaseLabels {
  return {
    volume,
    names: new Map(regions.map((r) => [r.value, r.name])),
    colours: new Map(regions.map((r) => [r.value, colourOf(r.colour)])),
  };
}

// Name of the region at a point of Image; empty: none.
export function regionAt(labels: CaseLabels, point: Vec3): string {
  const value = sampleNearest(labels.volume, point) ?? 0;
  return value > 0 ? (labels.names.get(value) ?? `region ${value}`) : "";
}

export function colourOf(css: string): Colour {
  const value = Number.parseInt(css.slice(1), 16);
  return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
}

// Hounsfield units below -500 mean CT; everything else is windowed by its percentiles.
function presetsOf(image: StatedImage): WindowPreset[] {
  if (image.min <= -500) {
    return [
      { name: "CT brain", window: 80, level: 40 },
      { name: "CT bone", window: 2500, level: 500 },
    ];
  }
  const at = (percent: number, otherwise: number) => image.percentiles.find(([p]) => p === percent)?.[1] ?? otherwise;
  const spread = (name: string, low: number, high: number): WindowPreset => ({
    name,
    window: Math.max(high - low, 1e-3),
    level: (low + high) / 2,
  });
  return [
    spread("MR 1–99 %", at(1, image.min), at(99, image.max)),
    spread("MR 50–99.9 %", at(50, image.min), at(99.9, image.max)),
    spread("Full range", image.min, image.max),
  ];
}
