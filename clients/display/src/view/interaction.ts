// Mouse and touch on the panels.
//
//   click           sets the cross hair               wheel          moves the plane; with Ctrl: zooms
//   drag            window and level                  double click   enlarges, and back
//   drag on a line  moves that plane; near its end    Shift or middle button   pans
//                   it turns the planes obliquely     right button   zooms
//   two fingers     zoom and pan
//
// A tool chosen in the bar (slice, pan, measure) takes the place of window and level. Slice is the wheel of a screen
// that has none: a drag up or down moves the plane.
import { intersection, kOrthogonalKinds, type OrthogonalKind, type Plane, toPlane } from "../geometry/planes.ts";
import { orbit, panned } from "../render/camera.ts";
import { type Rect, within } from "./layout.ts";
import type { Pen } from "./pen.ts";
import type { Followed, Measurement, ViewState } from "./view_state.ts";
import { isOrthogonal } from "./view_state.ts";

export type DragTool = "window" | "step" | "pan" | "measure";

export interface InteractionHost {
  readonly view: ViewState;
  readonly followed: Followed;
  rectOf(index: number): Rect | null;
  penOf(index: number): Pen | null;
  changed(): void;
  readonly windowRange: number; // of the image's values
}

type Drag = (x: number, y: number, dx: number, dy: number) => void;

const kClick_px = 4; // a shorter movement is a click
const kLine_px = 7; // catches a plane's line
const kFingerLine_px = 18;
const kStep_px = 4; // of a drag, per mm that a plane moves
const kTurn_fraction = 0.55; // of the half panel: beyond it a line turns the planes

export class Interaction {
  tool: DragTool = "window";
  pending: Measurement | null = null;
  private pointers = new Map<number, { x: number; y: number }>();
  private drag: { index: number; move: Drag; startX: number; startY: number; moved: boolean } | null = null;
  private pinch: { index: number; distance: number; x: number; y: number } | null = null;
  private lastClick = { time: Number.NEGATIVE_INFINITY, index: -1 };

  constructor(
    private readonly element: HTMLElement,
    private readonly host: InteractionHost,
  ) {
    element.addEventListener("pointerdown", (e) => this.down(e));
    element.addEventListener("pointermove", (e) => this.move(e));
    element.addEventListener("pointerup", (e) => this.up(e));
    element.addEventListener("pointercancel", (e) => this.cancel(e));
    element.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    element.addEventListener("contextmenu", (e) => e.preventDefault());
  }

  private at(e: MouseEvent): { x: number; y: number; index: number } {
    const box = this.element.getBoundingClientRect();
    const [x, y] = [e.clientX - box.left, e.clientY - box.top];
    const index = [0, 1, 2, 3].find((i) => {
      const rect = this.host.rectOf(i);
      return rect !== null && within(rect, x, y);
    });
    return { x, y, index: index ?? -1 };
  }

  private down(e: PointerEvent): void {
    const { x, y, index } = this.at(e);
    if (index < 0) return;
    this.element.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, { x, y });
    if (this.pointers.size === 2) {
      this.beginPinch(index);
      return;
    }
    this.drag = { index, move: this.dragFor(index, x, y, e), startX: x, startY: y, moved: false };
  }

  private move(e: PointerEvent): void {
    const before = this.pointers.get(e.pointerId);
    const { x, y, index } = this.at(e);
    if (!before) {
      this.showCursor(index, x, y);
      return;
    }
    this.pointers.set(e.pointerId, { x, y });
    if (this.pinch) {
      this.movePinch();
      return;
    }
    const drag = this.drag;
    if (!drag) return;
    if (!drag.moved && Math.hypot(x - drag.startX, y - drag.startY) < kClick_px) return;
    const [dx, dy] = drag.moved ? [x - before.x, y - before.y] : [x - drag.startX, y - drag.startY];
    drag.moved = true;
    drag.move(x, y, dx, dy);
    this.host.changed();
  }

  private up(e: PointerEvent): void {
    const { x, y } = this.at(e);
    const drag = this.drag;
    this.cancel(e);
    if (!drag) return;
    if (drag.moved) {
      if (this.pending) this.host.view.measurements.push(this.pending);
      this.pending = null;
    } else if (e.button === 0) this.click(drag.index, x, y, e.timeStamp);
    this.host.changed();
  }

  private cancel(e: PointerEvent): void {
    this.pointers.delete(e.pointerId);
    this.drag = null;
    if (this.pointers.size < 2) this.pinch = null;
  }

  private click(index: number, x: number, y: number, time: number): void {
    const { view } = this.host;
    const double = time - this.lastClick.time < 350 && this.lastClick.index === index;
    this.lastClick = double ? { time: Number.NEGATIVE_INFINITY, index: -1 } : { time, index };
    if (double) {
      view.layout = view.layout === "one" ? "2x2" : "one";
      view.big = index;
      return;
    }
    const pen = this.host.penOf(index);
    if (pen) view.setCursor(pen.image(x, y));
  }

  private dragFor(index: number, x: number, y: number, e: PointerEvent): Drag {
    const { view } = this.host;
    const kind = view.panels[index].kind;
    const panning = e.button === 1 || e.shiftKey || (this.tool === "pan" && e.button === 0);
    if (kind === "space")
      return panning ? this.panCamera(index) : e.button === 2 ? this.zoomCamera() : this.turnCamera();
    if (panning) return this.panPicture(index);
    if (e.button === 2) return this.zoomPicture(index, x, y);
    if (this.tool === "measure") return this.measure(index, x, y);
    const catch_px = e.pointerType === "touch" ? kFingerLine_px : kLine_px;
    const caught = isOrthogonal(kind) ? this.lineAt(index, kind, x, y, catch_px) : null;
    if (caught)
      return caught.turns ? this.turnPlanes(index, kind as OrthogonalKind) : this.movePlane(index, caught.plane);
    return this.tool === "step" ? this.stepPlane(index) : this.windowLevel();
  }

  private stepPlane(index: number): Drag {
    return (_x, _y, _dx, dy) => this.host.view.step(this.host.view.panels[index].kind, -dy / kStep_px);
  }

  private windowLevel(): Drag {
    return (_x, _y, dx, dy) => {
      const { view, windowRange } = this.host;
      const step = Math.max(view.window.window, windowRange / 200) / 250;
      view.window = {
        window: Math.max(windowRange / 1000, view.window.window + dx * step),
        level: view.window.level + dy * step,
      };
    };
  }

  private panPicture(index: number): Drag {
    return (_x, _y, dx, dy) => {
      const mm = this.host.penOf(index)?.mm_per_pixel ?? 0;
      this.host.view.pan(index, dx * mm, -dy * mm);
    };
  }

  private zoomPicture(index: number, x: number, y: number): Drag {
    return (_x, _y, _dx, dy) => this.zoomBy(index, Math.exp(-dy / 150), x, y);
  }

  private zoomBy(index: number, factor: number, x: number, y: number): void {
    const pen = this.host.penOf(index);
    if (!pen) return;
    const { u, v } = pen.millimetres(x, y);
    this.host.view.zoomAt(index, factor, u, v);
  }

  private measure(index: number, x: number, y: number): Drag {
    const from = this.host.penOf(index)?.image(x, y);
    return (toX, toY) => {
      const to = this.host.penOf(index)?.image(toX, toY);
      if (from && to) this.pending = { from, to };
    };
  }

  private movePlane(index: number, plane: OrthogonalKind): Drag {
    return (x, y) => {
      const pen = this.host.penOf(index);
      if (pen) this.host.view.movePlane(plane, pen.image(x, y));
    };
  }

  private turnPlanes(index: number, kind: OrthogonalKind): Drag {
    return (x, y, dx, dy) => {
      const pen = this.host.penOf(index);
      if (!pen) return;
      const c = pen.pixel(this.host.view.cursor);
      const before = Math.atan2(c.y - (y - dy), x - dx - c.x);
      const now = Math.atan2(c.y - y, x - c.x);
      this.host.view.turnOthers(kind, now - before);
    };
  }

  private turnCamera(): Drag {
    return (_x, _y, dx, dy) => {
      this.host.view.camera = orbit(this.host.view.camera, -dx / 150, -dy / 150);
    };
  }

  private panCamera(index: number): Drag {
    return (_x, _y, dx, dy) => {
      const rect = this.host.rectOf(index);
      const { view } = this.host;
      if (rect) view.camera = panned(view.cameraFor(rect), dx, dy);
    };
  }

  private zoomCamera(): Drag {
    return (_x, _y, _dx, dy) => this.zoomCameraBy(Math.exp(-dy / 150));
  }

  private zoomCameraBy(factor: number): void {
    const { view } = this.host;
    view.cameraZoom = Math.min(Math.max(view.cameraZoom * factor, 0.3), 20);
  }

  // The line of another plane under a pixel, and whether there it turns the planes.
  private lineAt(
    index: number,
    kind: OrthogonalKind,
    x: number,
    y: number,
    catch_px = kLine_px,
  ): { plane: OrthogonalKind; turns: boolean } | null {
    const { view, followed } = this.host;
    const pen = this.host.penOf(index);
    const rect = this.host.rectOf(index);
    if (!pen || !rect) return null;
    const point = pen.image(x, y);
    const c = pen.pixel(view.cursor);
    const fromCentre = Math.hypot(x - c.x, y - c.y);
    if (fromCentre < 12) return null;
    for (const other of kOrthogonalKinds) {
      if (other === kind) continue;
      const plane = view.planeOf(other, followed) as Plane;
      if (!intersection(pen.plane, plane)) continue;
      if (Math.abs(toPlane(plane, point).height_mm) > catch_px * pen.mm_per_pixel) continue;
      return { plane: other, turns: fromCentre > (kTurn_fraction * Math.min(rect.width, rect.height)) / 2 };
    }
    return null;
  }

  private showCursor(index: number, x: number, y: number): void {
    const kind = index >= 0 ? this.host.view.panels[index].kind : "space";
    const line =
      isOrthogonal(kind) && (this.tool === "window" || this.tool === "step") ? this.lineAt(index, kind, x, y) : null;
    this.element.dataset.cursor = line ? (line.turns ? "turn" : "line") : this.tool;
  }

  private wheel(e: WheelEvent): void {
    e.preventDefault();
    const { x, y, index } = this.at(e);
    if (index < 0) return;
    const { view } = this.host;
    const kind = view.panels[index].kind;
    const factor = Math.exp(-Math.sign(e.deltaY) * 0.12);
    if (kind === "space") this.zoomCameraBy(factor);
    else if (e.ctrlKey) this.zoomBy(index, factor, x, y);
    else view.step(kind, -Math.sign(e.deltaY) * (e.shiftKey ? 5 : 1));
    this.host.changed();
  }

  private beginPinch(index: number): void {
    this.drag = null;
    this.pending = null;
    const [a, b] = [...this.pointers.values()];
    this.pinch = { index, distance: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  }

  private movePinch(): void {
    const pinch = this.pinch;
    if (!pinch || this.pointers.size < 2) return;
    const [a, b] = [...this.pointers.values()];
    const now = {
      index: pinch.index,
      distance: Math.hypot(a.x - b.x, a.y - b.y),
      x: (a.x + b.x) / 2,
      y: (a.y + b.y) / 2,
    };
    const factor = now.distance / Math.max(pinch.distance, 1);
    if (this.host.view.panels[pinch.index].kind === "space") {
      this.zoomCameraBy(factor);
      this.panCamera(pinch.index)(now.x, now.y, now.x - pinch.x, now.y - pinch.y);
    } else {
      this.panPicture(pinch.index)(now.x, now.y, now.x - pinch.x, now.y - pinch.y);
      this.zoomBy(pinch.index, factor, now.x, now.y);
    }
    this.pinch = now;
    this.host.changed();
  }
}
