// What the viewer has chosen: layout, planes, cross hair, window. Nothing here comes from the daemon.
import {
  alongPlan,
  type Convention,
  centredAt,
  inline,
  kOrthogonalKinds,
  type Line,
  lookAhead,
  type OrthogonalKind,
  orthogonalPlane,
  type Plane,
  probeEye,
  type SliceKind,
  seenBy,
  toImage,
  toPlane,
  turned,
  viewer,
} from "../geometry/planes.ts";
import { add, along, scale, sub, type Vec3 } from "../geometry/vector.ts";
import type { Volume, Window } from "../image/volume.ts";
import type { Camera } from "../render/camera.ts";
import type { CaseData, Trajectory } from "../state/case_data.ts";
import type { Layout, Rect } from "./layout.ts";

export type PanelKind = SliceKind | "scanner" | "space";

export const kPanelNames: Readonly<Record<PanelKind, string>> = {
  axial: "Axial",
  coronal: "Coronal",
  sagittal: "Sagittal",
  probe_eye: "Probe’s eye",
  inline_1: "In-line 1",
  inline_2: "In-line 2",
  along_plan: "Along the plan",
  look_ahead: "Look-ahead",
  scanner: "Scanner’s slice",
  space: "3-D",
};

export interface PanelState {
  kind: PanelKind;
  zoom: number; // 1: the whole image fits
  pan_mm: readonly [number, number]; // of the picture's centre, along right and up
}

export interface Opacities {
  scalp: number;
  brain: number;
  structure: number;
  planes: boolean;
}

export interface Measurement {
  readonly from: Vec3;
  readonly to: Vec3;
}

// What probe views follow, and planes in step: the tool as it is shown now.
export interface Followed {
  readonly line: Line | null; // null: no pose is shown
  readonly trajectory: Trajectory | null;
}

const kProbeZoom = 2.2; // of the views that follow the probe, at first

export class ViewState {
  layout: Layout = "2x2";
  big = 0;
  panels: PanelState[] = (["axial", "coronal", "sagittal", "space"] as PanelKind[]).map(panelOf);
  convention: Convention = "radiological";
  follow = true; // planes at the tip, while a pose is shown
  cursor: Vec3 = [0, 0, 0];
  window: Window = { window: 100, level: 50 };
  ahead_mm = 10;
  labels = false; // an atlas of the whole brain would hide the image: on by choice
  labelOpacity = 0.35;
  second = ""; // name of the image that is blended over the case's; empty: none
  secondBlend = 0.5;
  scannerPlane: Plane | null = null; // of the scanner's latest slice
  trace = false;
  opacities: Opacities = { scalp: 0.18, brain: 0.35, structure: 1, planes: true };
  camera: Camera = { centre: [0, 0, 0], right: [-0.8, 0.6, 0], up: [-0.12, -0.16, 0.98], mm_per_pixel: 1 };
  cameraZoom = 1;
  measurements: Measurement[] = [];
  imageCentre: Vec3 = [0, 0, 0];
  extent_mm = 200; // of the image, its largest side
  // Orientation of the three planes; obliquely turned ones differ from those of the convention.
  private frames = framesOf("radiological");
  private lastLine: Line | null = null;
  private readonly lastRight = new Map<SliceKind, Vec3>(); // of the in-line planes' pictures

  reset(data: CaseData): void {
    const { size, T_image_index: T } = data.image;
    const half: Vec3 = [(size[0] - 1) / 2, (size[1] - 1) / 2, (size[2] - 1) / 2];
    const row = (r: number) => T[4 * r] * half[0] + T[4 * r + 1] * half[1] + T[4 * r + 2] * half[2] + T[4 * r + 3];
    this.imageCentre = [row(0), row(1), row(2)];
    const side = (c: number) => size[c] * Math.hypot(T[c], T[4 + c], T[8 + c]);
    this.extent_mm = Math.max(side(0), side(1), side(2));
    this.cursor = this.imageCentre;
    this.camera = { ...this.camera, centre: this.imageCentre };
    this.window = data.presets[0];
    this.measurements = [];
    if (!data.images.some((image) => image.name === this.second)) this.second = "";
    this.lastLine = null;
    this.lastRight.clear();
  }

  // One panel with the scanner's slice, whole.
  showScanner(volume: Volume): void {
    const T = volume.T_image_index;
    const side = (c: number) => volume.size[c] * Math.hypot(T[c], T[4 + c], T[8 + c]);
    this.extent_mm = Math.max(side(0), side(1));
    this.layout = "one";
    this.big = 0;
    if (this.panels[0].kind !== "scanner") this.panels[0] = { kind: "scanner", zoom: 1, pan_mm: [0, 0] };
  }

  setConvention(convention: Convention): void {
    this.convention = convention;
    this.lastRight.clear();
    this.straighten();
  }

  // Ends what was turned obliquely.
  straighten(): void {
    this.frames = framesOf(this.convention);
  }

  get oblique(): boolean {
    const straight = framesOf(this.convention);
    return kOrthogonalKinds.some(
      (kind) => this.frames[kind].right !== straight[kind].right || this.frames[kind].up !== straight[kind].up,
    );
  }

  setKind(index: number, kind: PanelKind): void {
    this.panels[index] = panelOf(kind);
  }

  // While no tip is shown: the cross hair is where one was last.
  get isAtLastTip(): boolean {
    return this.follow && this.lastLine !== null;
  }

  // The planes follow the tip.
  track(followed: Followed): void {
    if (!followed.line) return;
    this.lastLine = followed.line;
    if (this.follow) this.cursor = followed.line.tip;
  }

  // The plane through the cross hair, or of the probe; null while there is nothing to follow.
  planeOf(kind: SliceKind | "scanner", followed: Followed): Plane | null {
    if (kind === "scanner") return this.scannerPlane;
    if (kind === "axial" || kind === "coronal" || kind === "sagittal")
      return { centre: this.cursor, ...this.frames[kind] };
    if (kind === "along_plan") {
      const plan = followed.trajectory;
      if (!plan) return null;
      return seenBy(this.convention, alongPlan(plan.entry_mm, plan.target_mm, followed.line?.tip ?? null), null);
    }
    const line = followed.line ?? this.lastLine;
    if (!line) return null;
    if (kind === "probe_eye") return probeEye(line);
    if (kind === "look_ahead") return lookAhead(line, this.ahead_mm);
    const plane = seenBy(this.convention, inline(line, kind === "inline_1" ? 1 : 2), this.lastRight.get(kind) ?? null);
    this.lastRight.set(kind, plane.right);
    return plane;
  }

  // The plane with the centre of the picture as its centre. The three planes leave the image where it is, so that the
  // cross hair moves over it; those of the probe keep the tip in the middle.
  pictureOf(index: number, followed: Followed): Plane | null {
    const panel = this.panels[index];
    if (panel.kind === "space") return null;
    const plane = this.planeOf(panel.kind, followed);
    if (!plane) return null;
    const centred = isOrthogonal(panel.kind) ? centredAt(plane, this.imageCentre) : plane;
    return { ...centred, centre: toImage(centred, panel.pan_mm[0], panel.pan_mm[1]) };
  }

  mm_per_pixel(index: number, rect: Rect): number {
    return (1.05 * this.extent_mm) / Math.min(rect.width, rect.height) / this.panels[index].zoom;
  }

  cameraFor(rect: Rect): Camera {
    return {
      ...this.camera,
      mm_per_pixel: (1.25 * this.extent_mm) / Math.min(rect.width, rect.height) / this.cameraZoom,
    };
  }

  // Moves a plane along its normal by `mm` towards the viewer.
  step(kind: PanelKind, mm: number): void {
    if (kind === "look_ahead") this.ahead_mm = Math.min(Math.max(this.ahead_mm - mm, 0), 100);
    if (!isOrthogonal(kind)) return;
    this.follow = false;
    this.cursor = along(this.cursor, viewer({ centre: this.cursor, ...this.frames[kind] }), mm);
  }

  setCursor(point: Vec3): void {
    this.follow = false;
    this.cursor = point;
  }

  // The other two planes turn about this one's normal, at the cross hair.
  turnOthers(kind: OrthogonalKind, angle_rad: number): void {
    const axis = viewer({ centre: this.cursor, ...this.frames[kind] });
    for (const other of kOrthogonalKinds) {
      if (other === kind) continue;
      const { right, up } = turned({ centre: this.cursor, ...this.frames[other] }, this.cursor, axis, angle_rad);
      this.frames[other] = { right, up };
    }
  }

  // Moves one plane, seen as a line in the panel of another, through `point`.
  movePlane(kind: OrthogonalKind, point: Vec3): void {
    const plane = { centre: this.cursor, ...this.frames[kind] };
    const { height_mm } = toPlane(plane, point);
    this.setCursor(along(this.cursor, viewer(plane), height_mm));
  }

  pan(index: number, du_mm: number, dv_mm: number): void {
    const panel = this.panels[index];
    panel.pan_mm = [panel.pan_mm[0] - du_mm, panel.pan_mm[1] - dv_mm];
  }

  // Zooms about a point of the picture, which stays where it is.
  zoomAt(index: number, factor: number, u_mm: number, v_mm: number): void {
    const panel = this.panels[index];
    const zoom = Math.min(Math.max(panel.zoom * factor, 0.3), 40);
    const rest = 1 - panel.zoom / zoom;
    panel.pan_mm = [panel.pan_mm[0] + u_mm * rest, panel.pan_mm[1] + v_mm * rest];
    panel.zoom = zoom;
  }
}

export const isOrthogonal = (kind: PanelKind): kind is OrthogonalKind =>
  kOrthogonalKinds.includes(kind as OrthogonalKind);

function panelOf(kind: PanelKind): PanelState {
  return { kind, zoom: kind === "space" || isOrthogonal(kind) ? 1 : kProbeZoom, pan_mm: [0, 0] };
}

type Frames = Record<OrthogonalKind, { right: Vec3; up: Vec3 }>;

const straightFrames = new Map<Convention, Frames>();

function framesOf(convention: Convention): Frames {
  let frames = straightFrames.get(convention);
  if (!frames) {
    const of = (kind: OrthogonalKind) => {
      const { right, up } = orthogonalPlane(kind, [0, 0, 0], convention);
      return { right, up };
    };
    frames = { axial: of("axial"), coronal: of("coronal"), sagittal: of("sagittal") };
    straightFrames.set(convention, frames);
  }
  return { ...frames };
}

// Middle of two points.
export const middle = (a: Vec3, b: Vec3): Vec3 => add(a, scale(sub(b, a), 0.5));
