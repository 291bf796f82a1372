// The picture: one WebGL canvas with all panels, and one canvas over it for lines and letters.

import type { Plane } from "../geometry/planes.ts";
import type { Volume, Window } from "../image/volume.ts";
import { labelColours, type SliceLayers, SliceRenderer, type Viewport } from "../render/slice_renderer.ts";
import { VolumeTexture } from "../render/volume_texture.ts";
import type { CaseData } from "../state/case_data.ts";
import { panelRects, type Rect } from "./layout.ts";
import { Pen } from "./pen.ts";
import type { Scene } from "./scene.ts";
import { drawNoPlane, drawSliceOverlay } from "./slice_overlay.ts";
import { drawSpaceOverlay, SpaceView } from "./space_view.ts";
import type { Measurement, ViewState } from "./view_state.ts";

const kNoPlane: Plane = { centre: [0, 0, 0], right: [1, 0, 0], up: [0, 1, 0] }; // for texts alone
const kSecondTint: readonly [number, number, number] = [1, 1, 1];

interface Graphics {
  readonly gl: WebGL2RenderingContext;
  readonly slices: SliceRenderer;
  readonly space: SpaceView;
  image: VolumeTexture | null;
  labels: SliceLayers["labels"] | null;
  second: { readonly name: string; readonly texture: VolumeTexture; readonly window: Window } | null;
  scanner: { readonly volume: Volume; readonly texture: VolumeTexture } | null;
}

export interface DrawInput {
  readonly view: ViewState;
  readonly scene: Scene;
  readonly pending: Measurement | null;
  readonly bare: boolean;
}

export class Display {
  readonly element = document.createElement("div");
  private readonly picture = document.createElement("canvas");
  private readonly overlay = document.createElement("canvas");
  private readonly lines: CanvasRenderingContext2D;
  private graphics: Graphics | null = null;
  private data: CaseData | null = null;
  private rects: (Rect | null)[] = [];
  private keys: string[] = []; // what each panel shows: an unchanged picture is not drawn again
  private ratio = 1;

  // `changed` is called when the context was lost or restored, and when the size has changed.
  constructor(private readonly changed: () => void) {
    this.element.className = "picture";
    this.element.append(this.picture, this.overlay);
    // Drawn by the CPU: where WebGL is software, lines that are drawn by it cost more than the whole image.
    this.lines = this.overlay.getContext("2d", { willReadFrequently: true }) as CanvasRenderingContext2D;
    this.picture.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // so that it can be restored
      this.graphics = null;
      this.changed();
    });
    this.picture.addEventListener("webglcontextrestored", () => {
      this.begin();
      this.changed();
    });
    new ResizeObserver(() => {
      this.resize();
      this.changed();
    }).observe(this.element);
    this.begin();
  }

  get contextLost(): boolean {
    return this.graphics === null || this.graphics.gl.isContextLost();
  }

  setCase(data: CaseData | null): void {
    this.data = data;
    this.load();
  }

  get deformedKey(): string {
    return this.graphics?.space.deformedKey ?? "";
  }

  setDeformed(surface: Parameters<SpaceView["setDeformed"]>[0]): void {
    if ((surface?.key ?? "") === this.deformedKey) return;
    this.graphics?.space.setDeformed(surface);
    this.keys = [];
  }

  rectOf(index: number): Rect | null {
    return this.rects[index] ?? null;
  }

  penOf(index: number, view: ViewState, scene: Scene): Pen | null {
    const rect = this.rectOf(index);
    const plane = view.pictureOf(index, scene.followed);
    return rect && plane ? new Pen(this.lines, rect, plane, view.mm_per_pixel(index, rect)) : null;
  }

  // Milliseconds that it took, GPU included as far as the browser waits for it.
  draw(input: DrawInput): void {
    const graphics = this.graphics;
    if (!graphics || !this.data) return;
    const { view } = input;
    this.arrange(view);
    this.lines.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.lines.clearRect(0, 0, this.element.clientWidth, this.element.clientHeight);
    if (!graphics.image) return;
    const layers = this.layersOf(graphics, view, input.bare);
    graphics.gl.enable(graphics.gl.SCISSOR_TEST);
    view.panels.forEach((panel, index) => {
      const rect = this.rects[index];
      if (!rect) {
        this.keys[index] = "";
        return;
      }
      if (panel.kind === "space") this.drawSpace(graphics, layers, index, rect, input);
      else this.drawSlice(graphics, layers, index, rect, input);
    });
  }

  // A new arrangement begins with an empty canvas, so that nothing of the former one remains between the panels.
  private arrange(view: ViewState): void {
    const rects = panelRects(view.layout, view.big, this.element.clientWidth, this.element.clientHeight);
    if (JSON.stringify(rects) !== JSON.stringify(this.rects)) this.blank();
    this.rects = rects;
  }

  // Reads a pixel back, so that everything is drawn before this returns.
  finish(): void {
    const gl = this.graphics?.gl;
    gl?.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  // Picture and lines, as they are.
  copyTo(target: CanvasRenderingContext2D, x: number, y: number): void {
    for (const canvas of [this.picture, this.overlay]) {
      target.drawImage(canvas, x, y, this.element.clientWidth, this.element.clientHeight);
    }
  }

  // Draws nothing that was drawn before: for a cover.
  blank(): void {
    this.keys = [];
    this.lines.setTransform(1, 0, 0, 1, 0, 0);
    this.lines.clearRect(0, 0, this.overlay.width, this.overlay.height);
    const gl = this.graphics?.gl;
    if (!gl) return;
    gl.disable(gl.SCISSOR_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  // For tests: as a driver that is reset.
  loseContext(): { restore(): void } {
    const extension = this.graphics?.gl.getExtension("WEBGL_lose_context");
    extension?.loseContext();
    return { restore: () => extension?.restoreContext() };
  }

  private begin(): void {
    const gl = this.picture.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("It has no WebGL 2: no graphics card, or a driver that it does not trust");
    gl.clearColor(0, 0, 0, 1);
    const slices = new SliceRenderer(gl);
    this.graphics = {
      gl,
      slices,
      space: new SpaceView(gl, slices),
      image: null,
      labels: null,
      second: null,
      scanner: null,
    };
    this.load();
  }

  private load(): void {
    const graphics = this.graphics;
    this.keys = [];
    if (!graphics) return;
    const { gl } = graphics;
    graphics.image?.delete();
    graphics.labels?.texture.delete();
    graphics.second?.texture.delete();
    graphics.scanner?.texture.delete();
    graphics.second = graphics.scanner = null;
    graphics.image = this.data ? new VolumeTexture(gl, this.data.image) : null;
    const labels = this.data?.labels;
    graphics.labels = null;
    if (labels) {
      const { texture: colours, count } = labelColours(gl, labels.colours);
      graphics.labels = { texture: new VolumeTexture(gl, labels.volume), colours, count, opacity: 1 };
    }
    graphics.space.setCase(this.data);
  }

  private layersOf(graphics: Graphics, view: ViewState, bare: boolean): SliceLayers {
    const image = { texture: graphics.image as VolumeTexture, window: view.window };
    if (bare) return { image };
    const second = this.secondOf(graphics, view);
    return {
      image,
      ...(second && { second: { ...second, blend: view.secondBlend, tint: kSecondTint } }),
      ...(graphics.labels && view.labels && { labels: { ...graphics.labels, opacity: view.labelOpacity } }),
    };
  }

  // The second image is on the graphics card only while it is shown.
  private secondOf(graphics: Graphics, view: ViewState): Graphics["second"] {
    if ((graphics.second?.name ?? "") !== view.second) {
      graphics.second?.texture.delete();
      const chosen = this.data?.images.find((one) => one.name === view.second);
      graphics.second = chosen
        ? { name: chosen.name, texture: new VolumeTexture(graphics.gl, chosen.volume), window: chosen.window }
        : null;
    }
    return graphics.second;
  }

  // The scanner's slice: blended over the case's image where it lies in it, else alone.
  private scannerLayers(graphics: Graphics, layers: SliceLayers, { view, scene }: DrawInput): SliceLayers {
    const slice = scene.slice;
    if (!slice) return layers;
    if (graphics.scanner?.volume !== slice.volume) {
      graphics.scanner?.texture.delete();
      graphics.scanner = { volume: slice.volume, texture: new VolumeTexture(graphics.gl, slice.volume) };
    }
    const { texture } = graphics.scanner;
    if (!slice.registered) return { image: { texture, window: slice.window } };
    return {
      image: layers.image,
      second: { texture, window: slice.window, blend: view.secondBlend, tint: kSecondTint },
    };
  }

  private resize(): void {
    this.ratio = Math.min(window.devicePixelRatio || 1, 2);
    for (const canvas of [this.picture, this.overlay]) {
      canvas.width = Math.max(1, Math.round(this.element.clientWidth * this.ratio));
      canvas.height = Math.max(1, Math.round(this.element.clientHeight * this.ratio));
    }
    this.keys = [];
  }

  private viewportOf(rect: Rect): Viewport {
    const r = this.ratio;
    const viewport = {
      x: Math.round(rect.x * r),
      y: Math.round(this.picture.height - (rect.y + rect.height) * r),
      width: Math.round(rect.width * r),
      height: Math.round(rect.height * r),
    };
    this.graphics?.gl.scissor(viewport.x, viewport.y, viewport.width, viewport.height);
    return viewport;
  }

  // False if the panel shows this already.
  private isNew(index: number, what: unknown): boolean {
    const key = JSON.stringify(what);
    if (this.keys[index] === key) return false;
    this.keys[index] = key;
    return true;
  }

  private drawSlice(graphics: Graphics, layers: SliceLayers, index: number, rect: Rect, input: DrawInput): void {
    const { view, scene } = input;
    const pen = this.penOf(index, view, scene);
    const viewport = this.viewportOf(rect);
    if (!pen) {
      if (this.isNew(index, ["empty", rect])) graphics.gl.clear(graphics.gl.COLOR_BUFFER_BIT);
      drawNoPlane(new Pen(this.lines, rect, kNoPlane, 1), view.panels[index].kind, scene);
      return;
    }
    const { kind } = view.panels[index];
    const drawn = kind === "scanner" ? this.scannerLayers(graphics, layers, input) : layers;
    const shown = [
      pen.plane,
      pen.mm_per_pixel,
      rect,
      drawn.image.window,
      drawn.labels?.opacity,
      drawn.second && [view.second, drawn.second.blend],
      kind === "scanner" && [scene.slice?.record.device, scene.slice?.record.number],
    ];
    if (this.isNew(index, shown)) graphics.slices.draw(drawn, pen.plane, pen.mm_per_pixel / this.ratio, viewport);
    drawSliceOverlay(pen, { kind, view, scene, data: this.data as CaseData, pending: input.pending, bare: input.bare });
  }

  private drawSpace(graphics: Graphics, layers: SliceLayers, index: number, rect: Rect, input: DrawInput): void {
    const { view, scene, bare } = input;
    const viewport = this.viewportOf(rect);
    const planes = ["axial", "coronal", "sagittal"].map((kind) => view.planeOf(kind as "axial", scene.followed));
    const tools = scene.tools.map((t) => [t.tip, t.direction, t.verified, t.region_95]);
    const points = scene.points.map((p) => [p.predicted, p.extrapolated]);
    const arms = scene.arms.map((arm) => [arm.flange, arm.base]);
    const shown = [
      view.cameraFor(rect),
      planes,
      tools,
      arms,
      points,
      scene.plans,
      view.opacities,
      rect,
      view.window,
      [layers.labels?.opacity, layers.second && [view.second, view.secondBlend]],
      bare,
    ];
    if (this.isNew(index, shown)) graphics.space.draw(layers, view, scene, rect, viewport, bare);
    drawSpaceOverlay(this.lines, rect, view, scene, bare);
  }
}
