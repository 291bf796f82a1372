// Alarms that are not cleared, the gravest first, with a tone that one click silences.
import { AlarmState, Severity } from "../state/constants.ts";
import type { RecordOf } from "../state/layout.ts";
import type { CaselessPart, StateContext } from "./context.ts";
import { fill, h } from "./dom.ts";
import { Tone } from "./tone.ts";

const kWords: Readonly<Record<number, string>> = { 1: "info", 2: "warning", 3: "critical" };

export class Alarms implements CaselessPart {
  readonly element = h("aside", { class: "alarms", role: "alert" });
  readonly tone = new Tone();
  private heard = new Set<string>(); // alarms that were announced, with their counts

  update({ store }: StateContext): void {
    const raised = store
      .all("alarm")
      .filter((a) => a.state !== AlarmState.CLEARED)
      .sort((a, b) => b.severity - a.severity || b.changed_ms - a.changed_ms);
    const notes = raised.filter((a) => a.severity === Severity.INFO);
    const grave = raised.filter((a) => a.severity !== Severity.INFO);
    fill(this.element, `${store.revision("alarm")}`, () => [
      ...grave.map(row),
      ...(notes.length > 0 ? [line(notes)] : []),
    ]);
    this.announce(raised);
  }

  // A tone for each alarm that is new, or was raised again. A critical one repeats it until it is acknowledged.
  private announce(raised: readonly RecordOf<"alarm">[]): void {
    const open = raised.filter((a) => a.state === AlarmState.RAISED && a.severity >= Severity.WARNING);
    const keys = new Map(open.map((a) => [`${a.alarm} ${a.subject} ${a.count} ${a.severity}`, a]));
    for (const [key, alarm] of keys) if (!this.heard.has(key)) this.tone.play(alarm.severity === Severity.CRITICAL);
    this.heard = new Set(keys.keys());
    this.tone.repeat(open.some((a) => a.severity === Severity.CRITICAL));
  }
}

const titleOf = (a: RecordOf<"alarm">): string => [a.alarm.replaceAll("_", " "), a.subject].filter(Boolean).join(" · ");

// All that only informs, on one line: it must not take the place of what is read during the operation.
function line(notes: readonly RecordOf<"alarm">[]): HTMLElement {
  const all = notes.map(titleOf).join(", ");
  return h("div", { class: "alarm info", title: all }, h("strong", {}, all));
}

function row(a: RecordOf<"alarm">): HTMLElement {
  const kind = kWords[a.severity] ?? "critical"; // unknown is never good
  const acknowledged = a.state === AlarmState.ACKNOWLEDGED;
  const title = titleOf(a);
  return h(
    "div",
    { class: `alarm ${kind} ${acknowledged ? "acknowledged" : ""}` },
    h("strong", {}, title),
    h("span", {}, a.text),
    a.count > 1 ? h("span", { class: "count" }, `${a.count}×`) : null,
  );
}
