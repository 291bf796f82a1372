// Whether the picture must be covered, and why: the rule for a page that no longer hears its gateway, daemon or computer.
import type { LocalTime } from "./clock.ts";
import { CaseState, Presence } from "./constants.ts";
import type { RecordOf } from "./layout.ts";
import { elapsed_ms } from "./link.ts";

// A picture is covered after this time without a frame, or without a navigation state.
export const kSilent_ms = 1000;

export interface CoverInput {
  readonly now: LocalTime;
  readonly gateway_ms: number; // the gateway's clock now; NaN: not known
  readonly owedSince: LocalTime | null; // since when the gateway owes a frame; null: there was none
  readonly hidden: boolean; // the tab is in the background
  readonly contextLost: boolean;
  readonly awake: boolean; // false from a sleep or a hidden tab until everything was measured and received anew
  readonly link: RecordOf<"link"> | null;
  readonly linkWritten_ms: number; // when the gateway wrote it
  readonly caseRecord: RecordOf<"case"> | null;
  readonly caseLoaded: boolean; // its image and surfaces are in the page
  readonly scannerSlice: boolean; // a scanner's slice is in the page
  readonly failure: string; // of the page itself; empty: none
}

export interface Cover {
  readonly title: string;
  readonly text: string;
  readonly fraction?: number; // of a case on its way
  readonly pictureOnly?: boolean; // alarms and the pages that need no case stay: all but the case is heard
}

const seconds = (ms: number): string => `${(ms / 1000).toFixed(ms < 9950 ? 1 : 0)} s`;

export function coverOf(input: CoverInput): Cover | null {
  const cover = pageCover(input) ?? gatewayCover(input) ?? daemonCover(input);
  if (cover) return cover;
  // Without a case nothing navigates, and a slice is shown by itself, with its age.
  if (input.scannerSlice && hasNoCase(input)) return null;
  return caseCover(input) ?? stateCover(input);
}

const hasNoCase = ({ caseRecord }: CoverInput): boolean => !caseRecord || caseRecord.state === CaseState.NONE;

function pageCover(input: CoverInput): Cover | null {
  if (input.contextLost) {
    return {
      title: "Graphics interrupted",
      text: "This computer's graphics were reset. The picture returns with them.",
    };
  }
  if (input.hidden)
    return { title: "Page in the background", text: "Nothing is drawn while this page is not visible." };
  if (input.failure) return { title: "The page cannot go on", text: input.failure };
  return null;
}

function gatewayCover(input: CoverInput): Cover | null {
  if (!input.owedSince) return { title: "Connecting", text: "No word from bregma-gateway yet." };
  const silent_ms = elapsed_ms(input.owedSince, input.now);
  if (silent_ms >= kSilent_ms) {
    return { title: "Connection lost", text: `No word from bregma-gateway for ${seconds(silent_ms)}. Trying again.` };
  }
  if (!input.awake || !Number.isFinite(input.gateway_ms)) {
    return { title: "Resuming", text: "Waiting for the first state since this page was interrupted." };
  }
  return null;
}

function daemonCover(input: CoverInput): Cover | null {
  const { link } = input;
  if (link?.presence === Presence.ALIVE) return null;
  if (link?.presence === Presence.SILENT) {
    return { title: "bregmad is silent", text: link.text || `Nothing heard for ${seconds(link.silent_ms)}.` };
  }
  return { title: "bregmad not found", text: link?.text || "No daemon has been heard on this DDS domain." };
}

function caseCover(input: CoverInput): Cover | null {
  const record = input.caseRecord;
  if (!record || hasNoCase(input)) {
    return { title: "No case", text: record?.text || "Load a case.", pictureOnly: true };
  }
  const title = `Case ${record.id}`;
  if (record.state === CaseState.NO_SERVER)
    return { title, text: record.text || "No case server answers.", pictureOnly: true };
  if (record.state === CaseState.FAILED) return { title: `${title} failed`, text: record.text, pictureOnly: true };
  if (input.caseLoaded) return null;
  const arriving = record.state === CaseState.ON_ITS_WAY;
  return arriving
    ? { title, text: record.text || "On its way.", fraction: record.fraction, pictureOnly: true }
    : { title, text: "Loading the picture.", pictureOnly: true };
}

function stateCover(input: CoverInput): Cover | null {
  const last_ms = input.link?.last_state_ms ?? Number.NaN;
  if (!Number.isFinite(last_ms)) return { title: "No navigation state", text: "bregmad has not published one yet." };
  const age_ms = input.linkWritten_ms - last_ms;
  if (age_ms < kSilent_ms) return null;
  return { title: "No navigation state", text: `The latest one is ${seconds(age_ms)} old.` };
}
