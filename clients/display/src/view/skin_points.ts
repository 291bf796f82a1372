// Points of the skin in the 3-D panel, their legend, and what has to be known about them: whether the registration that
// places them is accepted, and where they are while none does.
import { sub, type Vec3 } from "../geometry/vector.ts";
import { kColours } from "./colours.ts";
import type { Rect } from "./layout.ts";
import type { Pen } from "./pen.ts";
import { distanceColour, isSurface, kFar_mm, type Scene } from "./scene.ts";

const kLegend = { width: 192, height: 8, steps: 24 } as const;
const kInset = 0.34; // of the panel's smaller side

export function drawSkinPoints(pen: Pen, scene: Scene): void {
  const surface = scene.captures.filter(isSurface);
  for (const capture of surface) pen.dot(capture.position, 3, distanceColour(capture.distance_mm));
  const { rect } = pen;
  if (surface.length > 0) {
    drawLegend(pen, rect.x + 12, rect.y + 44);
    if (scene.placedBy === "candidate") {
      pen.text(kNotAccepted, rect.x + 12, rect.y + 76, 13, kColours.unverified);
    }
  }
  if (scene.unplaced.length > 0) drawUnplaced(pen, scene);
}

export const kNotAccepted = "points: registration not accepted";

// Signed distance from the skin.
function drawLegend(pen: Pen, x: number, y: number): void {
  const { canvas: c } = pen;
  const { width, height, steps } = kLegend;
  for (let i = 0; i < steps; ++i) {
    c.fillStyle = distanceColour(kFar_mm * ((2 * i + 1) / steps - 1));
    c.fillRect(x + (i * width) / steps, y, width / steps + 0.5, height);
  }
  pen.text(`−${kFar_mm} inside`, x, y + 17, 12, kColours.letter);
  pen.text("0", x + width / 2, y + 17, 12, kColours.letter, "center");
  pen.text(`+${kFar_mm} mm`, x + width, y + 17, 12, kColours.letter, "right");
}

// Seen along the axis of their frame in which they reach least far: a scan of a face is seen from the front.
export interface Inset {
  readonly across: 0 | 1 | 2;
  readonly up: 0 | 1 | 2;
  readonly at: readonly { readonly x: number; readonly y: number }[]; // in the rectangle
}

export function insetOf(points: readonly Vec3[], rect: Rect): Inset {
  const low = [0, 1, 2].map((d) => Math.min(...points.map((p) => p[d]))) as unknown as Vec3;
  const reach = sub([0, 1, 2].map((d) => Math.max(...points.map((p) => p[d]))) as unknown as Vec3, low);
  const thin = reach.indexOf(Math.min(...reach));
  const [across, up] = ([0, 1, 2] as const).filter((d) => d !== thin);
  const scale = 0.8 * Math.min(rect.width / Math.max(reach[across], 1), rect.height / Math.max(reach[up], 1));
  const place = (p: Vec3) => ({
    x: rect.x + rect.width / 2 + scale * (p[across] - low[across] - reach[across] / 2),
    y: rect.y + rect.height / 2 - scale * (p[up] - low[up] - reach[up] / 2),
  });
  return { across, up, at: points.map(place) };
}

// No registration says where in the image they are. They are shown apart from it, so that nobody takes them for placed.
function drawUnplaced(pen: Pen, { unplaced, reference }: Scene): void {
  const { rect, canvas: c } = pen;
  const side = kInset * Math.min(rect.width, rect.height);
  const box: Rect = { x: rect.x + 12, y: rect.y + rect.height - side - 34, width: side, height: side };
  c.fillStyle = "rgba(8, 12, 16, 0.85)";
  c.fillRect(box.x, box.y, box.width, box.height);
  pen.stroke(kColours.unverified, 1, [4, 4], (path) => path.rect(box.x, box.y, box.width, box.height));
  const inset = insetOf(unplaced, box);
  c.fillStyle = kColours.unknown;
  for (const { x, y } of inset.at) c.fillRect(x - 1.5, y - 1.5, 3, 3);
  const axes = ["x", "y", "z"];
  pen.text(`${axes[inset.across]} →`, box.x + box.width - 6, box.y + box.height - 10, 12, kColours.muted, "right");
  pen.text(`${axes[inset.up]} ↑`, box.x + 6, box.y + 12, 12, kColours.muted);
  const text = `${unplaced.length} points in ${reference || "their own frame"}: not registered to the image yet`;
  pen.text(text, box.x, box.y + box.height + 14, 13, kColours.unverified);
}
