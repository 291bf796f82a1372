// The large figures: what a surgeon reads from two metres.
import { rms_mm } from "../geometry/ellipsoid.ts";
import { distance, inRigid, norm, type Vec3 } from "../geometry/vector.ts";
import { type CaseImage, regionAt } from "../state/case_data.ts";
import { PoseStatus } from "../state/constants.ts";
import type { RecordOf } from "../state/layout.ts";
import { figure, implausibleText, poseText } from "../state/text.ts";
import { hasPose } from "../state/validity.ts";
import type { PageContext, Part } from "./context.ts";
import { h, setClass, setText } from "./dom.ts";

const kDegrees = 180 / Math.PI;

class Figure {
  private readonly value = h("span", { class: "value" }, "–");
  private readonly detail = h("span", { class: "detail" });
  readonly element: HTMLElement;

  constructor(
    private readonly title: string,
    unit: string,
  ) {
    const unitText = h("span", { class: "unit" }, unit);
    this.element = h(
      "div",
      { class: "figure" },
      h("span", { class: "title" }, title, this.detail),
      h("span", {}, this.value, unitText),
    );
  }

  get text(): string {
    return `${this.title} ${this.detail.textContent} ${this.value.textContent}`;
  }

  set(value: string, detail = "", warn = false): void {
    setText(this.value, value);
    setText(this.detail, detail);
    setClass(this.element, "warn", warn);
    setClass(this.element, "empty", value === "–");
  }
}

export class Figures implements Part {
  private readonly tool = h("div", { class: "tool-name" });
  private readonly status = h("div", { class: "tool-status" });
  private readonly structure = new Figure("Nearest structure", "mm");
  private readonly depth = new Figure("Depth left", "mm");
  private readonly predicted = new Figure("To predicted target", "mm"); // beside that as imaged, never in its place
  private readonly lateral = new Figure("Lateral deviation", "mm");
  private readonly angle = new Figure("Angle", "°");
  private readonly region = new Figure("Tip error, 95 %", "mm");
  private readonly coordinates = h("div", { class: "coordinates" });
  readonly element = h(
    "section",
    { class: "figures" },
    h("div", { class: "tool" }, this.tool, this.status),
    this.depth.element,
    this.predicted.element,
    this.structure.element,
    h("div", { class: "pair" }, this.lateral.element, this.angle.element),
    this.region.element,
    this.coordinates,
  );

  // As text: for a screenshot.
  get lines(): string[] {
    const shown = [this.depth, this.predicted, this.structure, this.lateral, this.angle, this.region];
    const all = shown.filter((f) => !f.element.hidden).map((f) => f.text);
    return [
      `${this.tool.textContent}: ${this.status.textContent}`,
      all.join("  ·  "),
      this.coordinates.textContent ?? "",
    ].map((line) => line.replaceAll("\n", "  ·  "));
  }

  update({ scene, store, data, view }: PageContext): void {
    const tool = scene.followedTool;
    this.setPredicted(scene);
    setClass(this.element, "unverified", tool !== null && !tool.verified);
    setClass(this.element, "hidden-tool", tool === null);
    if (!tool) {
      const wanted =
        store.all("tool").find((t) => t.trajectory) ??
        store.all("tool").find((t) => data.tools.some((c) => c.name === t.tool && c.role !== "reference"));
      setText(this.tool, wanted?.tool ?? "No tool");
      setText(this.status, wanted ? whyHidden(wanted) : "");
      for (const f of [this.structure, this.depth, this.lateral, this.angle, this.region]) f.set("–");
    } else {
      const s = tool.shown.state;
      setText(this.tool, tool.name);
      setText(
        this.status,
        tool.verified ? `live · ${figure(tool.shown.age_ms, 0, "ms")}` : "NOT VERIFIED: for checks only",
      );
      const sigma_mm = s.nearest_structure_sigma_mm; // 0: not stated
      const error = sigma_mm > 0 ? ` ± ${figure(1.96 * sigma_mm, 1)}` : "";
      this.structure.set(figure(s.nearest_structure_mm, 1), s.nearest_structure + error, s.nearest_structure_mm < 3);
      this.depth.set(figure(s.remaining_depth_mm, 1), s.trajectory, s.remaining_depth_mm < -0.5);
      this.lateral.set(figure(s.lateral_deviation_mm, 1), "", s.lateral_deviation_mm > 2);
      this.angle.set(figure(s.angle_rad * kDegrees, 1));
      // Both of now: tre_rms_mm holds for the publication.
      this.region.set(figure(tool.region_95.semi_axes_mm[0], 1), `RMS ${figure(rms_mm(tool.region_95), 2)}`);
    }
    const region = view.labels && data.labels ? `\nRegion  ${regionAt(data.labels, view.cursor) || "–"}` : "";
    const second = data.images.find((image) => image.name === view.second);
    setText(this.coordinates, coordinatesText(tool?.tip ?? null, view.cursor, second) + region);
  }

  // Only while the tissue model predicts it.
  private setPredicted({ followedTool, target }: PageContext["scene"]): void {
    const left_mm = followedTool?.shown.state.distance_to_predicted_target_mm ?? Number.NaN;
    this.predicted.element.hidden = !Number.isFinite(left_mm);
    const moved_mm = target?.predicted ? distance(target.predicted, target.position) : Number.NaN;
    const bound = target && Number.isFinite(target.bound_mm) ? ` ± ${figure(target.bound_mm, 1)}` : "";
    const moved = Number.isFinite(moved_mm) ? `moved ${figure(moved_mm, 1)}${bound}` : "";
    const extrapolated = target?.extrapolated ?? false;
    this.predicted.set(figure(left_mm, 1), extrapolated ? `extrapolated, ${moved}` : moved, extrapolated);
  }
}

// Position in Image, in the words of the patient: "R 12.3".
// With a second image, the tip is also stated in the coordinates of that image.
export function coordinatesText(
  tip: Vec3 | null,
  cursor: Vec3,
  second?: Pick<CaseImage, "name" | "T_image_source">,
): string {
  const one = (p: Vec3) =>
    [0, 1, 2].map((d) => `${(p[d] >= 0 ? "RAS" : "LPI")[d]} ${Math.abs(p[d]).toFixed(1)}`).join("   ");
  const tipText = tip && Number.isFinite(norm(tip)) ? one(tip) : "–";
  const lines = [`Tip  ${tipText}`, `Cross hair  ${one(cursor)}`];
  if (second && tip && Number.isFinite(norm(tip))) {
    lines.push(`Tip in ${second.name}  ${one(inRigid(second.T_image_source, tip))}`);
  }
  return lines.join("\n");
}

// Why a tool is not shown. A pose that the daemon published as live can be too old by now.
function whyHidden(tool: RecordOf<"tool">): string {
  if (hasPose(tool)) return "pose too old";
  if (tool.status === PoseStatus.LIVE || tool.status === PoseStatus.UNVERIFIED) return "pose refused: not plausible";
  const why = tool.status === PoseStatus.IMPLAUSIBLE ? implausibleText(tool.plausibility_reason) : "";
  return poseText(tool.status) + (why && `: ${why}`);
}
