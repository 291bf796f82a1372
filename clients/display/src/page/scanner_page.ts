// Scanner: the registration of the robot's base to it, step by step, its coils, its distortion field, and the robot's
// tip. The registration is commanded elsewhere (`bregma mri step`).
import { CoilOutcome, PoseStatus, ScannerActivity, ScannerValidity, ScannerVerdict } from "../state/constants.ts";
import type { RecordOf } from "../state/layout.ts";
import {
  coilText,
  distortionFieldText,
  figure,
  poseText,
  scannerActivityText,
  scannerStepText,
  scannerValidityText,
  scannerVerdictText,
} from "../state/text.ts";
import type { CaselessPart, StateContext } from "./context.ts";
import { fill, h, setClass, setText, table } from "./dom.ts";

type Scanner = RecordOf<"scanner">;
type Coil = RecordOf<"scanner_coil">;
type RobotTool = RecordOf<"robot_tool">;

export class ScannerPage implements CaselessPart {
  private readonly status = h("p", { class: "lead" });
  private readonly next = h("p", { class: "small" });
  private readonly validity = h("p", { class: "lead" });
  private readonly rows = h("dl", { class: "pairs" });
  private readonly coils = h("div");
  private readonly coilsTitle = h("h3", {}, "Coils");
  private readonly tools = h("div");
  private readonly toolsTitle = h("h3", {}, "Robot’s tip in the scanner");
  readonly element = h(
    "section",
    { class: "page", id: "scanner-page" },
    h("h2", {}, "Scanner"),
    this.status,
    this.next,
    h("h3", {}, "Registration of the robot"),
    this.validity,
    this.rows,
    this.toolsTitle,
    this.tools,
    this.coilsTitle,
    this.coils,
  );

  update({ store, gateway_ms }: StateContext): void {
    const scanner = store.all("scanner")[0];
    setText(this.status, scanner ? statusText(scanner) : "No scanner is known");
    setClass(this.status, "bad", scanner?.activity === ScannerActivity.FAILED);
    setText(this.next, scanner?.next ?? "");
    const validity = scanner ? validityText(scanner) : "";
    setText(this.validity, validity.charAt(0).toUpperCase() + validity.slice(1));
    setClass(this.validity, "bad", scanner !== undefined && isVoid(scanner));
    fill(this.rows, `${store.revision("scanner")}`, () => (scanner ? pairsOf(scanner) : []));
    const coils = store.all("scanner_coil").filter((c) => c.device === scanner?.device);
    fill(this.coils, `${store.revision("scanner_coil")}`, () => (coils.length > 0 ? [coilTable(coils)] : []));
    this.coilsTitle.hidden = coils.length === 0;
    const tools = store.all("robot_tool");
    this.toolsTitle.hidden = tools.length === 0;
    const lines = tools.map((t) => tipText(t, gateway_ms));
    fill(this.tools, lines.join("\n"), () => lines.map((line) => h("p", { class: "small" }, line)));
  }
}

const isVoid = (s: Scanner) =>
  s.accepted_revision > 0 && s.validity !== ScannerValidity.VALID && s.validity !== ScannerValidity.NONE;

function statusText(s: Scanner): string {
  const activity = scannerActivityText(s.activity);
  const slices = s.protocol ? `, ${s.protocol} ${s.slices} of ${s.slices_expected} slices` : "";
  const step = scannerStepText(s.step);
  const more = s.text && s.text.toLowerCase() !== step.toLowerCase() ? ` (${s.text})` : "";
  return `${step}${activity ? `: ${activity}` : ""}${slices}${more}`;
}

export function validityText(s: Scanner): string {
  const text = scannerValidityText(s.validity);
  if (s.validity !== ScannerValidity.VALID) return s.validity_text ? `${text} (${s.validity_text})` : text;
  return `${text}, predicted error at the target ${figure(s.accepted_tre_95_mm, 2, "mm")} (95 %)`;
}

function pairsOf(s: Scanner): HTMLElement[] {
  const known = (value: number, unit: string) => figure(value, 2, unit);
  const pairs: [string, string][] = [];
  if (s.verdict !== ScannerVerdict.NONE) {
    pairs.push(["Latest estimate", scannerVerdictText(s.verdict) + (s.reason ? `: ${s.reason}` : "")]);
    pairs.push(["Predicted error (95 %)", known(s.tre_95_mm, "mm")]);
    pairs.push(["Coils that verify", known(s.verified_mm, "mm")]);
    pairs.push(["Consistency (FRE)", `${known(s.fre_mm, "mm")}, expected ${known(s.fre_expected_mm, "mm")}`]);
  }
  if (Number.isFinite(s.change_mm)) pairs.push(["Change against the accepted", known(s.change_mm, "mm")]);
  pairs.push([
    "Distortion field",
    distortionFieldText(s.field_status) +
      (Number.isFinite(s.field_residual_mm)
        ? `: ${known(s.field_initial_mm, "mm")}, ${known(s.field_residual_mm, "mm")} left`
        : ""),
  ]);
  pairs.push(["Slices corrected, refused", `${s.slices_corrected}, ${s.slices_refused}`]);
  if (s.refused_text) pairs.push(["Last refused", s.refused_text]);
  return pairs.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]);
}

function coilTable(coils: readonly Coil[]): HTMLElement {
  const bad = (c: Coil) => c.outcome === CoilOutcome.NOT_SEEN || c.outcome === CoilOutcome.OUTLIER;
  return table(
    [{ title: "Coil" }, { title: "" }, { title: "residual mm", number: true }, { title: "1 sigma mm", number: true }],
    coils.map((c) => [c.coil, coilText(c.outcome), figure(c.residual_mm, 2), figure(c.sigma_mm, 2)]),
    (row) => (bad(coils[row]) ? "bad" : ""),
  );
}

// A tip is stated only while its pose may be shown.
export function tipText(t: RobotTool, gateway_ms: number): string {
  const name = t.tool || t.device;
  const live = t.scanner_status === PoseStatus.LIVE && gateway_ms < t.valid_until_ms;
  if (!live) {
    const status = t.scanner_status === PoseStatus.LIVE ? PoseStatus.STALE : t.scanner_status;
    return `${name}: ${status === PoseStatus.NOT_REGISTERED ? "not registered to the scanner" : poseText(status)}`;
  }
  const at = t.scanner_tip_mm.map((v) => figure(v, 1)).join("  ");
  return `${name}: ${at} mm, error ${figure(t.scanner_error_95_mm, 1, "mm")} (95 %)`;
}
