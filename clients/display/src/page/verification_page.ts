// Verification: check touches, drift, and the predicted error at the targets.
import { figure } from "../state/text.ts";
import type { PageContext, Part } from "./context.ts";
import { fill, h, setClass, setText, table } from "./dom.ts";

export class VerificationPage implements Part {
  private readonly check = h("p", { class: "lead" });
  private readonly detail = h("p", { class: "small" });
  private readonly landmarks = h("div");
  private readonly drift = h("p", { class: "lead" });
  private readonly targets = h("div");
  readonly element = h(
    "section",
    { class: "page", id: "verification-page" },
    h("h2", {}, "Verification"),
    h("h3", {}, "Last check touch"),
    this.check,
    this.detail,
    this.landmarks,
    h("h3", {}, "Drift"),
    this.drift,
    h("h3", {}, "Predicted error (TRE) at the targets"),
    this.targets,
  );

  update({ store, data, scene }: PageContext): void {
    const accuracy = store.all("accuracy")[0];
    const last = accuracy?.last_check_mm ?? Number.NaN;
    const limit = data.limits.max_check_mm ?? Number.NaN;
    setText(this.check, Number.isFinite(last) ? `${figure(last, 2)} mm` : "None yet");
    setClass(this.check, "bad", last > limit);
    setText(
      this.detail,
      `${accuracy?.checks ?? 0} ${accuracy?.checks === 1 ? "check" : "checks"}; 95 % bound ${figure(accuracy?.last_check_limit_mm ?? Number.NaN, 2, "mm")}, limit ${figure(limit, 1, "mm")}`,
    );
    const distances = data.landmarks.map((l) =>
      scene.followedTool ? distanceTo(scene.followedTool.tip, l.position_mm) : Number.NaN,
    );
    const shown = distances.map((d) => figure(d, 1));
    fill(this.landmarks, shown.join(" ") + data.hash, () => [
      table(
        [{ title: "Landmark" }, { title: "tip now, mm", number: true }],
        data.landmarks.map((l, i) => [l.name, shown[i]]),
      ),
    ]);
    setText(this.drift, driftText(accuracy));
    setClass(this.drift, "bad", accuracy?.drift_detected === 1);
    const targets = store.all("target");
    const mostTre = data.limits.max_target_tre_mm ?? Number.NaN;
    fill(this.targets, `${store.revision("target")} ${mostTre}`, () => [
      table(
        [{ title: "Target" }, { title: "RMS mm", number: true }, { title: "95 % mm", number: true }],
        targets.map((t) => [t.target, figure(t.tre_rms_mm, 2), figure(t.tre_95_semi_axes_mm[0], 2)]),
        (r) => (targets[r].tre_rms_mm > mostTre ? "bad" : ""),
      ),
      h("p", { class: "small" }, `Limit: ${figure(mostTre, 1, "mm")} RMS.`),
    ]);
  }
}

function driftText(
  accuracy: { drift_threshold: number; drift_statistic: number; drift_detected: number } | undefined,
): string {
  if (!accuracy || !(accuracy.drift_threshold > 0)) return "Not tested yet";
  const ratio = figure((100 * accuracy.drift_statistic) / accuracy.drift_threshold, 0, "% of the threshold");
  return accuracy.drift_detected ? `The reference has moved (${ratio})` : `None detected (${ratio})`;
}

function distanceTo(a: readonly number[], b: readonly number[]): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
