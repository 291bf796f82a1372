// Case and side, session state, what to do next, and the time.

import type { CaseData } from "../state/case_data.ts";
import { DeviceKind, Session } from "../state/constants.ts";
import type { Store } from "../state/store.ts";
import { sessionText } from "../state/text.ts";
import { h, setText } from "./dom.ts";

const kGood: readonly number[] = [Session.VERIFIED, Session.NAVIGATING];
const kBad: readonly number[] = [Session.DEGRADED, Session.FAULT];
const kSides: Readonly<Record<string, string>> = { right: "RIGHT", left: "LEFT", both: "BOTH SIDES" };

export class TopBar {
  private readonly id = h("span", { class: "case-id" });
  private readonly patient = h("span", { class: "patient" });
  private readonly side = h("span", { class: "side" });
  private readonly session = h("span", { class: "session" });
  private readonly untracked = h("span", { class: "untracked" });
  private readonly next = h("span", { class: "next" });
  private readonly time = h("time", { class: "time" });
  readonly element = h(
    "header",
    { class: "top" },
    this.id,
    this.side,
    this.patient,
    this.session,
    this.untracked,
    this.next,
    this.time,
  );

  setPatient(text: string): void {
    setText(this.patient, text);
  }

  update(store: Store, data: CaseData | null): void {
    const record = store.all("session")[0];
    const state = record?.session ?? 0;
    setText(this.id, data?.id ?? store.all("case")[0]?.id ?? "");
    setText(this.side, kSides[data?.side ?? ""] ?? "");
    this.side.hidden = !data?.side;
    setText(this.session, sessionText(state));
    this.session.className = `session ${kGood.includes(state) ? "good" : kBad.includes(state) ? "bad" : ""}`;
    // An arm in the place of a tracker does not follow the patient.
    const untracked = store.all("tool").some((tool) => tool.source_kind === DeviceKind.ROBOT);
    setText(this.untracked, untracked ? "PATIENT NOT TRACKED" : "");
    this.untracked.hidden = !untracked;
    setText(this.next, record?.next ?? "");
    setText(this.time, new Date().toLocaleTimeString("en-GB"));
  }

  // For a screenshot.
  get text(): string {
    return [this.id, this.side, this.patient, this.session, this.untracked, this.next]
      .map((e) => e.textContent)
      .filter(Boolean)
      .join("  ·  ");
  }
}
