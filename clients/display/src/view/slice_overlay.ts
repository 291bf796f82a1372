// Lines, marks and letters over a slice.
import { cut, outline } from "../geometry/ellipsoid.ts";
import { edgeLetters } from "../geometry/letters.ts";
import { intersection, kOrthogonalKinds, type Plane } from "../geometry/planes.ts";
import { rmsAt } from "../geometry/pose_error.ts";
import { add, along, distance, scale, type Vec3 } from "../geometry/vector.ts";
import type { CaseData, Trajectory } from "../state/case_data.ts";
import { figure } from "../state/text.ts";
import { kColours } from "./colours.ts";
import type { Pen } from "./pen.ts";
import { distanceColour, isSurface, type Scene, type SceneTool, tipAhead } from "./scene.ts";
import { kNotAccepted } from "./skin_points.ts";
import { isOrthogonal, kPanelNames, type Measurement, type PanelKind, type ViewState } from "./view_state.ts";

const kNear_mm = 3; // points are drawn in full up to this distance from the plane
const kFar_mm = 12; // and not at all beyond this one
const kShaft_mm = 160;
const kExtrapolated = [2, 5]; // dashes of a prediction that is extrapolated
const kAhead_mm = 60;
const kCorrected2d = 4; // DistortionCorrection
const kCorrected3d = 5;

export interface OverlayInput {
  readonly kind: PanelKind;
  readonly view: ViewState;
  readonly scene: Scene;
  readonly data: CaseData;
  readonly pending: Measurement | null; // a measurement that is being drawn
  readonly bare: boolean; // only the image: for the benchmark
}

export function drawSliceOverlay(pen: Pen, input: OverlayInput): void {
  const { canvas: c, rect } = pen;
  c.save();
  c.beginPath();
  c.rect(rect.x, rect.y, rect.width, rect.height);
  c.clip();
  if (input.kind === "scanner" && !input.scene.slice?.registered) {
    drawScanner(pen, input);
    c.restore();
    return;
  }
  if (!input.bare) {
    drawCuts(pen, input.data);
    drawPlanes(pen, input);
    for (const plan of input.scene.plans) drawPlan(pen, plan);
    drawPlanNames(pen, input.scene);
    drawPoints(pen, input);
    if (input.view.trace) drawTrace(pen, input.scene);
    for (const tool of input.scene.tools) drawTool(pen, tool, tool === input.scene.followedTool);
    drawMeasurements(pen, input);
  }
  drawFrame(pen, input);
  if (input.kind === "scanner") drawSliceText(pen, input.scene);
  c.restore();
}

// A panel that has nothing to show says why.
export function drawNoPlane(pen: Pen, kind: PanelKind, scene: Scene): void {
  const { rect } = pen;
  const why =
    kind === "scanner" ? "no slice has been received" : kind === "along_plan" ? noPlanText(scene) : "no pose until now";
  pen.text(kPanelNames[kind], rect.x + 10, rect.y + 18, 16, kColours.letter, "left", true);
  pen.text(why, rect.x + 10, rect.y + 38, 13, kColours.unverified);
}

const noPlanText = ({ plans }: Scene): string => (plans.length > 1 ? "no plan is followed" : "the case has no plan");

// A slice that lies in no known place of the case's image: the robot's tip is all that is known beside it.
function drawScanner(pen: Pen, { scene }: OverlayInput): void {
  const { rect } = pen;
  pen.text(kPanelNames.scanner, rect.x + 10, rect.y + 18, 16, kColours.letter, "left", true);
  drawSliceText(pen, scene);
  const tip = scene.slice?.tip;
  if (tip) {
    const colour = Math.abs(tip.distance_mm) <= kNear_mm ? kColours.live : kColours.muted;
    pen.line(along(tip.foot, tip.direction, -kShaft_mm), tip.foot, colour, 3);
    pen.circle(tip.foot, Math.max(4, tip.error_95_mm / pen.mm_per_pixel), colour, 2);
    const p = pen.pixel(tip.foot);
    pen.text(figure(tip.distance_mm, 1, "mm"), p.x + 12, p.y - 12, 15, colour);
  }
  drawScaleBar(pen);
}

const kOldSlice_ms = 10_000;

// Which slice it is, how old, whether it is corrected, and that it does not lie in the case's image.
function drawSliceText(pen: Pen, { slice }: Scene): void {
  const { rect } = pen;
  const line = (row: number, text: string, colour: string) =>
    pen.text(text, rect.x + 10, rect.y + 38 + 18 * row, 13, colour);
  if (!slice) {
    line(0, "no slice has been received", kColours.muted);
    return;
  }
  const { protocol, series, index, count, correction, max_shift_mm } = slice.record;
  const old = !(slice.age_ms < kOldSlice_ms);
  const age = Number.isFinite(slice.age_ms) ? `${figure(slice.age_ms / 1000, 0, "s")} old` : "of unknown age";
  line(0, `${protocol} ${series}, slice ${index} of ${count}, ${age}`, old ? kColours.unverified : kColours.muted);
  const corrected = correction === kCorrected2d || correction === kCorrected3d;
  if (corrected) line(1, `distortion corrected, up to ${figure(max_shift_mm, 1, "mm")}`, kColours.muted);
  else line(1, "DISTORTION NOT CORRECTED", kColours.unverified);
  if (!slice.registered) line(2, "in its own frame, not registered to a case’s image", kColours.unverified);
}

function drawCuts(pen: Pen, data: CaseData): void {
  for (const m of data.meshes) {
    if (m.kind === "tissue") continue;
    const colour = m.kind === "brain" ? kColours.brain : m.kind === "scalp" ? kColours.scalp : m.css;
    pen.segments(m.cutter.cut(pen.plane), colour, m.kind === "structure" ? 2 : 1);
  }
}

// The other two planes as lines, which leave the cross hair's place free, and the cross hair.
function drawPlanes(pen: Pen, { kind, view, scene }: OverlayInput): void {
  const centre = view.cursor;
  const reach = view.extent_mm * 1.5;
  if (!isOrthogonal(kind)) return;
  for (const other of kOrthogonalKinds) {
    if (other === kind) continue;
    const plane = view.planeOf(other, scene.followed) as Plane;
    const line = intersection(pen.plane, plane);
    if (!line) continue;
    const gap = 12 * pen.mm_per_pixel;
    for (const side of [-1, 1]) {
      pen.line(
        along(centre, line.direction, side * gap),
        along(centre, line.direction, side * reach),
        kColours[other],
        1.25,
      );
    }
  }
}

function drawPlan(pen: Pen, plan: Trajectory): void {
  pen.line(plan.entry_mm, plan.target_mm, kColours.plan, 1.5, [7, 5]);
  drawNear(pen, plan.entry_mm, (alpha) => {
    pen.canvas.globalAlpha = alpha;
    const p = pen.pixel(plan.entry_mm);
    pen.stroke(kColours.plan, 2, [], (c) => {
      c.moveTo(p.x - 8, p.y - 8);
      c.lineTo(p.x + 8, p.y + 8);
      c.moveTo(p.x - 8, p.y + 8);
      c.lineTo(p.x + 8, p.y - 8);
    });
  });
  const inPlane = inPlaneStretch(pen, plan.entry_mm, plan.target_mm);
  if (inPlane) pen.line(inPlane[0], inPlane[1], kColours.plan, 3);
}

// Which is which, where several are drawn since none is followed.
export function drawPlanNames(pen: Pen, { plans }: Scene): void {
  if (plans.length < 2) return;
  for (const plan of plans) {
    const p = pen.pixel(plan.entry_mm);
    pen.text(plan.name, p.x + 12, p.y - 10, 13, kColours.plan);
  }
}

// The part of a line that is within a millimetre of the plane.
function inPlaneStretch(pen: Pen, from: Vec3, to: Vec3): [Vec3, Vec3] | null {
  const a = pen.pixel(from).height_mm;
  const b = pen.pixel(to).height_mm;
  const at = (h: number) => (Math.abs(b - a) < 1e-9 ? (Math.abs(a) <= 1 ? h : 2) : (h - a) / (b - a));
  const s = [at(-1), at(1)].sort((x, y) => x - y);
  const low = Math.abs(b - a) < 1e-9 ? 0 : Math.max(s[0], 0);
  const high = Math.abs(b - a) < 1e-9 ? (Math.abs(a) <= 1 ? 1 : -1) : Math.min(s[1], 1);
  if (high <= low) return null;
  const point = (t: number) => add(scale(from, 1 - t), scale(to, t));
  return [point(low), point(high)];
}

// Draws a point with an opacity that falls with its distance from the plane.
function drawNear(pen: Pen, point: Vec3, draw: (alpha: number) => void): void {
  const height = Math.abs(pen.pixel(point).height_mm);
  if (height > kFar_mm) return;
  draw(height <= kNear_mm ? 1 : 0.75 * (1 - (height - kNear_mm) / (kFar_mm - kNear_mm)) + 0.1);
  pen.canvas.globalAlpha = 1;
}

function drawPoints(pen: Pen, { scene }: OverlayInput): void {
  for (const capture of scene.captures) {
    if (!isSurface(capture) || Math.abs(pen.pixel(capture.position).height_mm) > kNear_mm) continue;
    pen.circle(capture.position, 2.5, distanceColour(capture.distance_mm), 1.5);
  }
  for (const f of scene.fiducials) {
    drawNear(pen, f.position, (alpha) => {
      pen.canvas.globalAlpha = alpha;
      const colour = f.suspect ? kColours.suspect : kColours.fiducial;
      pen.circle(f.position, 6, colour, 2);
      if (f.residual_mm) pen.line(f.position, add(f.position, scale(f.residual_mm, 5)), colour, 2); // five times its length
      const p = pen.pixel(f.position);
      pen.text(f.name, p.x + 9, p.y - 9, 13, colour);
    });
  }
  for (const point of scene.points) drawPoint(pen, point, point === scene.target);
}

function drawPoint(pen: Pen, point: Scene["points"][number], isTarget: boolean): void {
  drawNear(pen, point.position, (alpha) => {
    pen.canvas.globalAlpha = alpha;
    pen.circle(point.position, isTarget ? 9 : 5, kColours.target, isTarget ? 3 : 1.5);
    if (isTarget) pen.circle(point.position, 1.5, kColours.target, 3);
  });
  const predicted = point.predicted;
  if (!predicted) return;
  drawNear(pen, predicted, (alpha) => {
    pen.canvas.globalAlpha = alpha;
    pen.line(point.position, predicted, kColours.predicted, 1.5);
    const dash = point.extrapolated ? kExtrapolated : [];
    pen.diamond(predicted, isTarget ? 9 : 5, kColours.predicted, isTarget ? 3 : 1.5, dash);
  });
}

function drawTool(pen: Pen, tool: SceneTool, followed: boolean): void {
  const colour = tool.verified ? kColours.live : kColours.unverified;
  const dash = tool.verified ? [] : [10, 6];
  pen.canvas.globalAlpha = followed ? 1 : 0.6;
  const fill = tool.verified ? "rgba(69, 224, 160, 0.22)" : "rgba(255, 171, 46, 0.22)";
  pen.ellipse(outline(tool.region_95, tool.tip, pen.plane), colour, 1, [3, 3]);
  const section = cut(tool.region_95, tool.tip, pen.plane);
  if (section) pen.ellipse(section, colour, 1.5, [], fill);
  pen.line(tipAhead(tool, -kShaft_mm), tool.tip, colour, 3, dash);
  pen.line(tool.tip, tipAhead(tool, kAhead_mm), colour, 1.25, [2, 5]);
  pen.circle(tool.tip, 4, colour, 2.5);
  pen.canvas.globalAlpha = 1;
}

// Where the tip was, as far as that is near the plane.
function drawTrace(pen: Pen, { trace, followedTool }: Scene): void {
  if (!followedTool) return;
  const colour = followedTool.verified ? kColours.live : kColours.unverified;
  const isNear = (point: Vec3) => Math.abs(pen.pixel(point).height_mm) <= kNear_mm;
  for (let i = 1; i < trace.length; ++i)
    if (isNear(trace[i - 1]) && isNear(trace[i])) pen.line(trace[i - 1], trace[i], colour, 1.5);
}

function drawMeasurements(pen: Pen, { view, pending }: OverlayInput): void {
  for (const m of pending ? [...view.measurements, pending] : view.measurements) {
    const near = Math.min(Math.abs(pen.pixel(m.from).height_mm), Math.abs(pen.pixel(m.to).height_mm));
    if (near > kFar_mm) continue;
    pen.line(m.from, m.to, kColours.measure, 1.5);
    pen.circle(m.from, 3, kColours.measure, 1.5);
    pen.circle(m.to, 3, kColours.measure, 1.5);
    const a = pen.pixel(m.from);
    const b = pen.pixel(m.to);
    pen.text(figure(distance(m.from, m.to), 1, "mm"), (a.x + b.x) / 2 + 8, (a.y + b.y) / 2 - 10, 16, kColours.measure);
  }
}

// Title, letters, scale bar, and what the tool is if it is not verified.
function drawFrame(pen: Pen, { kind, view, scene, data }: OverlayInput): void {
  const { rect } = pen;
  const letters = edgeLetters(pen.plane);
  const size = Math.max(17, Math.min(26, rect.height / 18));
  const [cx, cy] = [rect.x + rect.width / 2, rect.y + rect.height / 2];
  pen.text(letters.left, rect.x + 10, cy, size, kColours.letter, "left", true);
  pen.text(letters.right, rect.x + rect.width - 10, cy, size, kColours.letter, "right", true);
  pen.text(letters.top, cx, rect.y + size * 0.8, size, kColours.letter, "center", true);
  pen.text(letters.bottom, cx, rect.y + rect.height - size * 0.8, size, kColours.letter, "center", true);

  const title = kind === "look_ahead" ? `${kPanelNames[kind]} ${figure(view.ahead_mm, 0, "mm")}` : kPanelNames[kind];
  const colour = isOrthogonal(kind) ? kColours[kind] : kColours.letter;
  pen.text(title, rect.x + 10, rect.y + 18, 16, colour, "left", true);
  if (kind !== "scanner") {
    const rows = drawRemarks(pen, kind, view, scene);
    drawSecondText(pen, view, data, rows);
  }
  drawNotVerified(pen, scene);
  if (scene.placedBy === "candidate" && scene.captures.some(isSurface)) {
    pen.text(kNotAccepted, rect.x + rect.width - 12, rect.y + rect.height - 14, 13, kColours.unverified, "right");
  }
  drawScaleBar(pen);
}

// Below the title. Returns the number of rows.
function drawRemarks(pen: Pen, kind: PanelKind, view: ViewState, scene: Scene): number {
  const { rect } = pen;
  let rows = 0;
  const remark = (text: string, colour: string) => pen.text(text, rect.x + 10, rect.y + 38 + 18 * rows++, 13, colour);
  if (isOrthogonal(kind) && view.oblique) remark("oblique", kColours.muted);
  if (scene.followed.line || kind === "along_plan") return rows;
  if (!isOrthogonal(kind)) remark("no pose: the plane is where it was", kColours.unverified);
  else if (view.isAtLastTip) remark("no pose: the cross hair is where the tip was", kColours.letter);
  return rows;
}

export function drawNotVerified(pen: Pen, { followedTool }: Scene): void {
  if (!followedTool || followedTool.verified) return;
  const { rect } = pen;
  pen.text("NOT VERIFIED", rect.x + rect.width - 12, rect.y + 18, 16, kColours.unverified, "right", true);
}

// Which image is blended over the case's, and the error of its registration at the cross hair; below the title.
function drawSecondText(pen: Pen, view: ViewState, data: CaseData, row: number): void {
  const image = data.images.find((one) => one.name === view.second);
  if (!image) return;
  const line = (at: number, text: string, colour: string) =>
    pen.text(text, pen.rect.x + 10, pen.rect.y + 38 + 18 * at, 13, colour);
  const error = rmsAt(image.covariance, view.cursor);
  line(row, `${image.name}: ±${figure(error, 1, "mm")} RMS at the cross hair`, kColours.letter);
  if (image.accepted) line(row + 1, `not confirmed: ${image.accepted}`, kColours.unverified);
}

function drawScaleBar(pen: Pen): void {
  const { rect } = pen;
  const wanted_mm = (rect.width / 5) * pen.mm_per_pixel;
  const length_mm = [100, 50, 20, 10, 5, 2, 1].find((l) => l <= wanted_mm) ?? 1;
  const [x, y] = [rect.x + 12, rect.y + rect.height - 14];
  const width = length_mm / pen.mm_per_pixel;
  pen.stroke(kColours.letter, 2, [], (c) => {
    c.moveTo(x, y - 4);
    c.lineTo(x, y);
    c.lineTo(x + width, y);
    c.lineTo(x + width, y - 4);
  });
  pen.text(`${length_mm} mm`, x, y - 14, 13, kColours.letter); // above: beside it is the letter of a small panel
}
