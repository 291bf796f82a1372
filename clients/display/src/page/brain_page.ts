// Brain: predicted displacements, phase, forces, and force and displacement against depth.
import { distance, type Vec3 } from "../geometry/vector.ts";
import type { RecordOf } from "../state/layout.ts";
import type { Store } from "../state/store.ts";
import { deformationReasonText, deformationText, figure, phaseText } from "../state/text.ts";
import type { Scene } from "../view/scene.ts";
import type { PageContext, Part } from "./context.ts";
import { DepthPlot } from "./depth_plot.ts";
import { fill, h, setClass, setText, table } from "./dom.ts";

export type SurfaceColour = "plain" | "displacement" | "stress";

export class BrainPage implements Part {
  colour: SurfaceColour = "displacement";
  private readonly status = h("p", { class: "lead" });
  private readonly rows = h("dl", { class: "pairs" });
  private readonly points = h("div");
  private readonly plot = new DepthPlot();
  private readonly scale = h("div", { class: "colour-scale" });
  private lastTime_ms = Number.NaN;
  readonly element: HTMLElement;

  constructor(private readonly changed: () => void) {
    const choice = h(
      "select",
      { "aria-label": "Colour of the brain", change: (e: Event) => this.choose((e.target as HTMLSelectElement).value) },
      h("option", { value: "displacement" }, "coloured by displacement"),
      h("option", { value: "stress" }, "coloured by von Mises stress"),
      h("option", { value: "plain" }, "plain"),
    );
    this.element = h(
      "section",
      { class: "page", id: "brain-page" },
      h("h2", {}, "Brain"),
      this.status,
      this.rows,
      h("h3", {}, "Predicted displacement"),
      this.points,
      h("h3", {}, "Force and displacement against depth"),
      this.plot.element,
      h("h3", {}, "Deformed surface"),
      choice,
      this.scale,
    );
  }

  private choose(value: string): void {
    this.colour = value as SurfaceColour;
    this.changed();
  }

  setScale(largest: number): void {
    const unit = this.colour === "stress" ? "Pa" : "mm";
    setText(
      this.scale,
      this.colour === "plain" ? "" : `0 to ${figure(largest, this.colour === "stress" ? 0 : 1, unit)}`,
    );
  }

  update({ store }: PageContext): void {
    const states = store.all("deformation");
    const model = states[0];
    if (!model) {
      setText(this.status, "No tissue model is running");
      fill(this.rows, "none", () => []);
      fill(this.points, "none", () => []);
      return;
    }
    const why = deformationReasonText(model.reason);
    setText(this.status, deformationText(model.status) + (why ? `: ${why}` : ""));
    setClass(this.status, "bad", model.status === 4);
    this.plot.draw();
    fill(this.rows, `${store.revision("deformation")}`, () => modelRows(model));
    fill(this.points, `${store.revision("deformation")}`, () => [pointTable(states)]);
  }

  // At every draw, also while another page is shown: the plot has the whole insertion.
  collect(store: Store, scene: Scene): void {
    const states = store.all("deformation");
    const model = states[0];
    if (!model || model.time_ms === this.lastTime_ms) return;
    this.lastTime_ms = model.time_ms;
    const target = scene.target?.name;
    const followed = states.find((s) => s.point === target);
    const moved_mm = followed ? displacementOf(followed) : Number.NaN;
    this.plot.add(model.depth_mm, model.tip_force_N, moved_mm, model.ruptures, target ?? "");
  }
}

function displacementOf(s: RecordOf<"deformation">): number {
  return distance(s.displaced_mm as unknown as Vec3, s.imaged_mm as unknown as Vec3);
}

function modelRows(m: RecordOf<"deformation">): HTMLElement[] {
  const pairs: [string, string][] = [
    ["Phase", phaseText(m.phase)],
    ["Depth in the tissue", figure(m.depth_mm, 1, "mm")],
    ["Force of the tip", figure(m.tip_force_N, 3, "N")],
    ["Friction of the shaft", figure(m.shaft_force_N, 3, "N")],
    ["Measured force", figure(m.measured_force_N, 3, "N")],
    ["Ruptures", `${m.ruptures}${m.ruptures ? `, the last at ${figure(m.rupture_force_N, 3, "N")}` : ""}`],
  ];
  return pairs.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]);
}

function pointTable(states: readonly RecordOf<"deformation">[]): HTMLElement {
  return table(
    [{ title: "" }, { title: "mm", number: true }, { title: "± mm", number: true }, { title: "Pa", number: true }],
    states.map((s) => [s.point, figure(displacementOf(s), 2), figure(s.error_bound_mm, 2), figure(s.von_mises_Pa, 0)]),
  );
}
