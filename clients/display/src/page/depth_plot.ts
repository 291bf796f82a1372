// Force of the tip and displacement of the plan's target against the probe's depth in the tissue, since the page was
// opened, the probe was last outside, or another target was followed.
import { h } from "./dom.ts";

const kWidth = 400;
const kHeight = 190;
const kMargin = { left: 46, right: 46, top: 12, bottom: 30 };
const kSamples = 4000;

interface Sample {
  readonly depth_mm: number;
  readonly force_N: number;
  readonly displacement_mm: number;
  readonly rupture: boolean;
}

export class DepthPlot {
  readonly element: HTMLCanvasElement = h("canvas", { class: "plot" });
  private samples: Sample[] = [];
  private ruptures = 0;
  private target = "";
  private isDrawn = false; // with all samples

  constructor() {
    this.element.width = 2 * kWidth;
    this.element.height = 2 * kHeight;
    this.draw();
  }

  // A depth of zero after an insertion begins a new curve, and so does another target.
  add(depth_mm: number, force_N: number, displacement_mm: number, ruptures: number, target: string): void {
    if (!Number.isFinite(depth_mm)) return;
    if (target !== this.target) {
      this.target = target;
      this.samples = [];
      this.isDrawn = false;
    }
    const last = this.samples.at(-1);
    if (depth_mm <= 0 && (!last || last.depth_mm <= 0)) return;
    if (depth_mm > 0 && last && last.depth_mm <= 0) this.samples = [];
    this.samples.push({
      depth_mm,
      force_N,
      displacement_mm,
      rupture: ruptures > this.ruptures && this.samples.length > 0,
    });
    this.ruptures = ruptures;
    if (this.samples.length > kSamples) this.samples = this.samples.filter((s, i) => i % 2 === 0 || s.rupture);
    this.isDrawn = false;
  }

  draw(): void {
    if (this.isDrawn) return;
    this.isDrawn = true;
    const c = this.element.getContext("2d") as CanvasRenderingContext2D;
    c.setTransform(2, 0, 0, 2, 0, 0);
    c.clearRect(0, 0, kWidth, kHeight);
    const depth = niceTop(
      this.samples.map((s) => s.depth_mm),
      10,
    );
    const force = niceTop(
      this.samples.map((s) => s.force_N),
      0.1,
    );
    const displacement = niceTop(
      this.samples.map((s) => s.displacement_mm),
      1,
    );
    axes(c, depth, force, displacement, this.target);
    this.curve(c, depth, force, (s) => s.force_N, "#ffe066");
    this.curve(c, depth, displacement, (s) => s.displacement_mm, "#ff7ad9");
    for (const s of this.samples) {
      if (!s.rupture) continue;
      c.strokeStyle = "#ff5c5c";
      c.beginPath();
      c.moveTo(xOf(s.depth_mm, depth), kMargin.top);
      c.lineTo(xOf(s.depth_mm, depth), kHeight - kMargin.bottom);
      c.stroke();
    }
  }

  private curve(
    c: CanvasRenderingContext2D,
    depth: number,
    top: number,
    value: (s: Sample) => number,
    colour: string,
  ): void {
    c.strokeStyle = colour;
    c.lineWidth = 1.5;
    c.beginPath();
    let drawing = false;
    for (const s of this.samples) {
      const v = value(s);
      if (!Number.isFinite(v)) {
        drawing = false;
        continue;
      }
      const [x, y] = [xOf(s.depth_mm, depth), yOf(v, top)];
      if (drawing) c.lineTo(x, y);
      else c.moveTo(x, y);
      drawing = true;
    }
    c.stroke();
  }
}

const xOf = (v: number, top: number): number => kMargin.left + (v / top) * (kWidth - kMargin.left - kMargin.right);
const yOf = (v: number, top: number): number =>
  kHeight - kMargin.bottom - (v / top) * (kHeight - kMargin.top - kMargin.bottom);

// The next of 1, 2, 5 times a power of ten above all values.
function niceTop(values: readonly number[], least: number): number {
  let largest = least;
  for (const v of values) if (v > largest) largest = v;
  const power = 10 ** Math.floor(Math.log10(largest));
  return [1, 2, 5, 10].map((f) => f * power).find((top) => top >= largest * 0.999) ?? 10 * power;
}

function axes(c: CanvasRenderingContext2D, depth: number, force: number, displacement: number, target: string): void {
  const [left, right] = [kMargin.left, kWidth - kMargin.right];
  const [top, bottom] = [kMargin.top, kHeight - kMargin.bottom];
  c.strokeStyle = "#33414f";
  c.lineWidth = 1;
  c.strokeRect(left, top, right - left, bottom - top);
  c.font = '12px system-ui, "DejaVu Sans", sans-serif';
  c.textBaseline = "middle";
  const number = (v: number) => String(Number(v.toPrecision(3)));
  for (const t of [0, 0.5, 1]) {
    const y = bottom - t * (bottom - top);
    c.fillStyle = "#ffe066";
    c.textAlign = "right";
    c.fillText(number(t * force), left - 5, y);
    c.fillStyle = "#ff7ad9";
    c.textAlign = "left";
    c.fillText(number(t * displacement), right + 5, y);
    c.fillStyle = "#8b98a6";
    c.textAlign = "center";
    c.fillText(number(t * depth), left + t * (right - left), bottom + 10);
  }
  c.fillText("depth, mm", (left + right) / 2, kHeight - 7);
  c.textAlign = "left";
  c.fillStyle = "#ffe066";
  c.fillText("force, N", left + 6, top + 9);
  c.textAlign = "right";
  c.fillStyle = "#ff7ad9";
  c.fillText(`${target || "target"} moved, mm`, right - 6, top + 9);
}
