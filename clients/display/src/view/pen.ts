// Draws into one panel of the overlay in millimetres of its picture.
import type { Ellipse } from "../geometry/ellipsoid.ts";
import type { Segments } from "../geometry/mesh_cut.ts";
import { type Plane, toImage, toPlane } from "../geometry/planes.ts";
import type { Vec3 } from "../geometry/vector.ts";
import type { Rect } from "./layout.ts";

export class Pen {
  constructor(
    readonly canvas: CanvasRenderingContext2D,
    readonly rect: Rect,
    readonly plane: Plane,
    readonly mm_per_pixel: number,
  ) {}

  x(u_mm: number): number {
    return this.rect.x + this.rect.width / 2 + u_mm / this.mm_per_pixel;
  }

  y(v_mm: number): number {
    return this.rect.y + this.rect.height / 2 - v_mm / this.mm_per_pixel;
  }

  // Pixel of a point's foot on the plane.
  pixel(point: Vec3): { x: number; y: number; height_mm: number } {
    const { u_mm, v_mm, height_mm } = toPlane(this.plane, point);
    return { x: this.x(u_mm), y: this.y(v_mm), height_mm };
  }

  // Position in Image of a pixel of the canvas.
  image(x: number, y: number): Vec3 {
    const { u, v } = this.millimetres(x, y);
    return toImage(this.plane, u, v);
  }

  millimetres(x: number, y: number): { u: number; v: number } {
    return {
      u: (x - this.rect.x - this.rect.width / 2) * this.mm_per_pixel,
      v: (this.rect.y + this.rect.height / 2 - y) * this.mm_per_pixel,
    };
  }

  line(from: Vec3, to: Vec3, colour: string, width: number, dash: readonly number[] = []): void {
    const a = this.pixel(from);
    const b = this.pixel(to);
    this.stroke(colour, width, dash, (c) => {
      c.moveTo(a.x, a.y);
      c.lineTo(b.x, b.y);
    });
  }

  polyline(points: readonly Vec3[], colour: string, width: number): void {
    if (points.length < 2) return;
    this.stroke(colour, width, [], (c) => {
      points.forEach((point, i) => {
        const p = this.pixel(point);
        if (i === 0) c.moveTo(p.x, p.y);
        else c.lineTo(p.x, p.y);
      });
    });
  }

  circle(point: Vec3, radius_px: number, colour: string, width: number, fill?: string): void {
    const p = this.pixel(point);
    this.stroke(colour, width, [], (c) => c.arc(p.x, p.y, radius_px, 0, 2 * Math.PI), fill);
  }

  // A small mark that costs little, for thousands of points.
  dot(point: Vec3, size_px: number, colour: string): void {
    const p = this.pixel(point);
    this.canvas.fillStyle = colour;
    this.canvas.fillRect(p.x - size_px / 2, p.y - size_px / 2, size_px, size_px);
  }

  diamond(point: Vec3, radius_px: number, colour: string, width: number, dash: readonly number[] = []): void {
    const p = this.pixel(point);
    this.stroke(colour, width, dash, (c) => {
      c.moveTo(p.x, p.y - radius_px);
      c.lineTo(p.x + radius_px, p.y);
      c.lineTo(p.x, p.y + radius_px);
      c.lineTo(p.x - radius_px, p.y);
      c.closePath();
    });
  }

  ellipse(e: Ellipse, colour: string, width: number, dash: readonly number[], fill?: string): void {
    const [a, b] = e.semi_axes_mm.map((s) => s / this.mm_per_pixel);
    const [x, y] = [this.x(e.centre_mm[0]), this.y(e.centre_mm[1])];
    this.stroke(colour, width, dash, (c) => c.ellipse(x, y, a, b, -e.angle_rad, 0, 2 * Math.PI), fill);
  }

  segments({ uv_mm, count }: Segments, colour: string, width: number): void {
    if (count === 0) return;
    const [cx, cy] = [this.x(0), this.y(0)];
    const s = 1 / this.mm_per_pixel;
    this.stroke(colour, width, [], (c) => {
      for (let i = 0; i < 4 * count; i += 4) {
        c.moveTo(cx + uv_mm[i] * s, cy - uv_mm[i + 1] * s);
        c.lineTo(cx + uv_mm[i + 2] * s, cy - uv_mm[i + 3] * s);
      }
    });
  }

  // Text with a dark rim, so that it can be read on any picture.
  text(
    text: string,
    x: number,
    y: number,
    size: number,
    colour: string,
    align: CanvasTextAlign = "left",
    bold = false,
  ): void {
    const c = this.canvas;
    c.font = `${bold ? "600 " : ""}${size}px system-ui, "DejaVu Sans", sans-serif`;
    c.textAlign = align;
    c.textBaseline = "middle";
    c.lineJoin = "round";
    c.lineWidth = Math.max(3, size / 6);
    c.strokeStyle = "rgba(0, 0, 0, 0.85)";
    c.strokeText(text, x, y);
    c.fillStyle = colour;
    c.fillText(text, x, y);
  }

  stroke(
    colour: string,
    width: number,
    dash: readonly number[],
    path: (c: CanvasRenderingContext2D) => void,
    fill?: string,
  ): void {
    const c = this.canvas;
    c.beginPath();
    path(c);
    if (fill) {
      c.fillStyle = fill;
      c.fill();
    }
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.lineCap = "round";
    c.setLineDash(dash as number[]);
    c.stroke();
    c.setLineDash([]);
  }
}
