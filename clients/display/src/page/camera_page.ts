// Camera: where each tool is in the working volume, which marker is hidden, and which way to move.
//
// The volume is a frustum before the tracker, as bregmad states it in the tracker's `device` record: x to its right, y up
// or down, z away from it.
import { type Mat3, multiply, negate, unit, type Vec3 } from "../geometry/vector.ts";
import { ToolStatus } from "../state/constants.ts";
import type { RecordOf } from "../state/layout.ts";
import { figure, toolText } from "../state/text.ts";
import type { CaselessPart, StateContext } from "./context.ts";
import { fill, h } from "./dom.ts";

type Volume = Pick<
  RecordOf<"device">,
  "volume_near_mm" | "volume_far_mm" | "volume_half_width_rad" | "volume_half_height_rad"
>;

const kSize = 200;
const kName_px = 13; // height of a name
const kDepthMargin_mm = 50;

export class CameraPage implements CaselessPart {
  private readonly above = plan();
  private readonly side = plan();
  private readonly tools = h("div");
  private readonly size = h("p", { class: "small" });
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
    this.size,
  );

  update({ store, data }: StateContext): void {
    const tracked = store.all("tracked_tool");
    const trackers = store.all("device").filter((d) => d.volume_far_mm > 0);
    const volumeOf = (device: string) => trackers.find((d) => d.device === device) ?? null;
    // The tracker whose tools are listed first; the pictures show its volume and its tools.
    const shown = volumeOf(tracked[0]?.device ?? "") ?? trackers[0] ?? null;
    const inside = tracked.filter((t) => !shown || t.device === shown.device);
    drawVolume(this.above, inside, shown, 0);
    drawVolume(this.side, inside, shown, 1);
    this.size.textContent = volumeText(shown);
    fill(this.tools, `${store.revision("tracked_tool")} ${store.revision("device")}`, () =>
      tracked.map((t) => {
        const model = data?.tools.find((m) => m.name === t.tool);
        return h(
          "div",
          { class: `camera-tool ${isSeen(t) ? "" : "bad"}` },
          h("strong", {}, t.tool),
          h("span", {}, toolText(t.status)),
          model ? markerDots(model.markers_mm.length, t.used_markers) : null,
          h("span", { class: "advice" }, advice(t, model?.normal ?? null, volumeOf(t.device))),
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
export function advice(t: RecordOf<"tracked_tool">, normal: Vec3 | null, volume: Volume | null): string {
  const p = t.translation_mm as unknown as Vec3;
  if (!p.every(Number.isFinite))
    return t.status === ToolStatus.OUT_OF_VOLUME ? "Move it back before the camera." : "Clear the view of the camera.";
  const [x, y, z] = p;
  if (volume) {
    if (z < volume.volume_near_mm + kDepthMargin_mm) return "Move away from the camera.";
    if (z > volume.volume_far_mm - kDepthMargin_mm) return "Move towards the camera.";
    const across = x / (z * Math.tan(volume.volume_half_width_rad));
    const updown = y / (z * Math.tan(volume.volume_half_height_rad));
    if (Math.abs(across) > 0.9) return "Move to the middle of the camera’s view (sideways).";
    if (Math.abs(updown) > 0.9) return "Move to the middle of the camera’s view (up or down).";
  }
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

export function volumeText(volume: Volume | null): string {
  if (!volume) return "The tracker’s working volume is not stated.";
  const metres = (mm: number) => figure(mm / 1000, 2);
  const degrees = (half_rad: number) => `${figure((2 * half_rad * 180) / Math.PI, 0)}°`;
  return `Working volume: ${metres(volume.volume_near_mm)} to ${metres(volume.volume_far_mm)} m, ${degrees(
    volume.volume_half_width_rad,
  )} wide, ${degrees(volume.volume_half_height_rad)} high.`;
}

function plan(): HTMLCanvasElement {
  const canvas = h("canvas", { class: "volume" });
  canvas.width = canvas.height = 2 * kSize;
  return canvas;
}

// The frustum with the camera at the bottom; `axis` is that across. Without a stated volume the tools alone are drawn.
function drawVolume(
  canvas: HTMLCanvasElement,
  tools: readonly RecordOf<"tracked_tool">[],
  volume: Volume | null,
  axis: 0 | 1,
): void {
  const c = canvas.getContext("2d") as CanvasRenderingContext2D;
  c.setTransform(2, 0, 0, 2, 0, 0);
  c.clearRect(0, 0, kSize, kSize);
  const deepest_mm = Math.max(volume?.volume_far_mm ?? 0, ...tools.filter(isSeen).map((t) => t.translation_mm[2]), 500);
  const tangent = volume ? Math.tan(axis === 0 ? volume.volume_half_width_rad : volume.volume_half_height_rad) : 0;
  // Both the depth and the width fit in the picture.
  const scale = Math.min((kSize - 30) / deepest_mm, (0.5 * kSize - 4) / (deepest_mm * tangent));
  const at = (across: number, away: number): [number, number] => [
    kSize / 2 + across * scale,
    kSize - 12 - away * scale,
  ];
  if (volume) {
    const { volume_near_mm: near, volume_far_mm: far } = volume;
    c.strokeStyle = "#3f5163";
    c.fillStyle = "#131b24";
    c.beginPath();
    c.moveTo(...at(-near * tangent, near));
    c.lineTo(...at(near * tangent, near));
    c.lineTo(...at(far * tangent, far));
    c.lineTo(...at(-far * tangent, far));
    c.closePath();
    c.fill();
    c.stroke();
  }
  c.fillStyle = "#8b98a6";
  const [x, y] = at(0, 0);
  c.fillRect(x - 14, y, 28, 6);
  c.font = '12px system-ui, "DejaVu Sans", sans-serif';
  const seen = tools.filter(isSeen).map((tool) => {
    const [px, py] = at(tool.translation_mm[axis], tool.translation_mm[2]);
    return { tool, px, py };
  });
  seen.sort((a, b) => a.py - b.py);
  const right = Math.max(...seen.map((s) => s.px)) + 12;
  let row = Number.NEGATIVE_INFINITY; // of the last name: names of tools that are close stand below each other
  for (const { tool, px, py } of seen) {
    row = Math.max(py, row + kName_px);
    c.fillStyle = c.strokeStyle = tool.status === ToolStatus.VISIBLE ? "#45e0a0" : "#ffab2e";
    c.beginPath();
    c.arc(px, py, 4, 0, 2 * Math.PI);
    c.fill();
    c.globalAlpha = 0.5;
    c.beginPath();
    c.moveTo(px, py);
    c.lineTo(right - 2, row);
    c.stroke();
    c.globalAlpha = 1;
    c.fillText(tool.tool, right, row + 4);
  }
}
