// Camera: where each tool is in the working volume, which marker is hidden, and which way to move.
//
// The volume is a frustum before the tracker: x to its right, y up or down, z away from it, as in bregmad's parameters
// tracker.near_mm to tracker.half_height_deg, whose defaults are drawn. The daemon does not publish its own.
import { type Mat3, multiply, negate, unit, type Vec3 } from "../geometry/vector.ts";
import { ToolStatus } from "../state/constants.ts";
import type { RecordOf } from "../state/layout.ts";
import { figure, toolText } from "../state/text.ts";
import type { PageContext, Part } from "./context.ts";
import { fill, h } from "./dom.ts";

export const kVolume = { near_mm: 950, far_mm: 2400, half_width_deg: 30, half_height_deg: 26 };

const kSize = 200;
const tangent = (degrees: number) => Math.tan((degrees * Math.PI) / 180);

export class CameraPage implements Part {
  private readonly above = plan();
  private readonly side = plan();
  private readonly tools = h("div");
  readonly element = h(
    "section",
    { class: "page", id: "camera-page" },
    h("h2", {}, "Camera"),
    h(
      "div",
      { class: "views" },
      h("figure", {}, this.above, h("figcaption", {}, "from above")),
      h("figure", {}, this.side, h("figcaption", {}, "from the side")),
    ),
    this.tools,
    h("p", { class: "small" }, "The volume drawn is bregmad’s default: 0.95 to 2.40 m, 60° wide, 52° high."),
  );

  update({ store, data }: PageContext): void {
    const tracked = store.all("tracked_tool");
    drawVolume(this.above, tracked, 0, kVolume.half_width_deg);
    drawVolume(this.side, tracked, 1, kVolume.half_height_deg);
    fill(this.tools, `${store.revision("tracked_tool")}`, () =>
      tracked.map((t) => {
        const model = data.tools.find((m) => m.name === t.tool);
        return h(
          "div",
          { class: `camera-tool ${isSeen(t) ? "" : "bad"}` },
          h("strong", {}, t.tool),
          h("span", {}, toolText(t.status)),
          model ? markerDots(model.markers_mm.length, t.used_markers) : null,
          h("span", { class: "advice" }, advice(t, model?.normal ?? null)),
        );
      }),
    );
  }
}

const isSeen = (t: RecordOf<"tracked_tool">) =>
  t.status === ToolStatus.VISIBLE || t.status === ToolStatus.PARTLY_VISIBLE;

function markerDots(count: number, used: number): HTMLElement {
  const dots = Array.from({ length: count }, (_, i) =>
    h("i", { class: (used >> i) & 1 ? "seen" : "", title: `marker ${i + 1}` }),
  );
  return h("span", { class: "markers" }, ...dots);
}

// What the operator can do about a tool that is seen badly.
export function advice(t: RecordOf<"tracked_tool">, normal: Vec3 | null): string {
  const p = t.translation_mm as unknown as Vec3;
  if (!p.every(Number.isFinite))
    return t.status === ToolStatus.OUT_OF_VOLUME ? "Move it back before the camera." : "Clear the view of the camera.";
  const [x, y, z] = p;
  if (z < kVolume.near_mm + 50) return "Move away from the camera.";
  if (z > kVolume.far_mm - 50) return "Move towards the camera.";
  const across = x / (z * tangent(kVolume.half_width_deg));
  const updown = y / (z * tangent(kVolume.half_height_deg));
  if (Math.abs(across) > 0.9) return "Move to the middle of the camera’s view (sideways).";
  if (Math.abs(updown) > 0.9) return "Move to the middle of the camera’s view (up or down).";
  if (normal && t.rotation.every(Number.isFinite)) {
    const facing = multiply(t.rotation as unknown as Mat3, normal);
    const towards = unit(negate(p));
    const cosine = facing[0] * towards[0] + facing[1] * towards[1] + facing[2] * towards[2];
    if (cosine < Math.cos((55 * Math.PI) / 180))
      return `Turn its markers to the camera (${figure((Math.acos(cosine) * 180) / Math.PI, 0, "°")}).`;
  }
  return t.status === ToolStatus.PARTLY_VISIBLE
    ? "A marker is covered."
    : `${figure(Math.hypot(x, y, z) / 1000, 2, "m")} away`;
}

function plan(): HTMLCanvasElement {
  const canvas = h("canvas", { class: "volume" });
  canvas.width = canvas.height = 2 * kSize;
  return canvas;
}

// The frustum with the camera at the bottom; `axis` is that across.
function drawVolume(
  canvas: HTMLCanvasElement,
  tools: readonly RecordOf<"tracked_tool">[],
  axis: 0 | 1,
  half_deg: number,
): void {
  const c = canvas.getContext("2d") as CanvasRenderingContext2D;
  c.setTransform(2, 0, 0, 2, 0, 0);
  c.clearRect(0, 0, kSize, kSize);
  const scale = (kSize - 30) / kVolume.far_mm;
  const at = (across: number, away: number): [number, number] => [
    kSize / 2 + across * scale,
    kSize - 12 - away * scale,
  ];
  const t = tangent(half_deg);
  c.strokeStyle = "#3f5163";
  c.fillStyle = "#131b24";
  c.beginPath();
  c.moveTo(...at(-kVolume.near_mm * t, kVolume.near_mm));
  c.lineTo(...at(kVolume.near_mm * t, kVolume.near_mm));
  c.lineTo(...at(kVolume.far_mm * t, kVolume.far_mm));
  c.lineTo(...at(-kVolume.far_mm * t, kVolume.far_mm));
  c.closePath();
  c.fill();
  c.stroke();
  c.fillStyle = "#8b98a6";
  const [x, y] = at(0, 0);
  c.fillRect(x - 14, y, 28, 6);
  c.font = '12px system-ui, "DejaVu Sans", sans-serif';
  for (const tool of tools) {
    if (!isSeen(tool)) continue;
    const [px, py] = at(tool.translation_mm[axis], tool.translation_mm[2]);
    c.fillStyle = tool.status === ToolStatus.VISIBLE ? "#45e0a0" : "#ffab2e";
    c.beginPath();
    c.arc(px, py, 5, 0, 2 * Math.PI);
    c.fill();
    c.fillText(tool.tool, px + 8, py + 4);
  }
}
