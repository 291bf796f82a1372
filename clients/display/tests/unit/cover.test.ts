import assert from "node:assert/strict";
import { test } from "node:test";
import { type CoverInput, coverOf } from "../../src/state/cover.ts";
import type { RecordOf } from "../../src/state/layout.ts";

const at = (ms: number) => ({ timer_ms: ms, wall_ms: 1e9 + ms });

const good: CoverInput = {
  now: at(5000),
  gateway_ms: 100_000,
  owedSince: at(4990),
  hidden: false,
  contextLost: false,
  awake: true,
  link: { silent_ms: 5, last_state_ms: 99_990, presence: 2, text: "" } as RecordOf<"link">,
  linkWritten_ms: 100_000,
  caseRecord: { state: 3, id: "colin27", fraction: 1, text: "" } as RecordOf<"case">,
  caseLoaded: true,
  scannerSlice: false,
  failure: "",
};
const link = (change: Partial<RecordOf<"link">>) => ({ link: { ...good.link, ...change } as RecordOf<"link"> });
const caseRecord = (change: Partial<RecordOf<"case">>) => ({
  caseRecord: { ...good.caseRecord, ...change } as RecordOf<"case">,
});

test("nothing covers a picture whose states arrive", () => {
  assert.equal(coverOf(good), null);
});

test("a gateway that owes a frame for 1 s covers the picture, by whichever clock says more", () => {
  assert.equal(coverOf({ ...good, owedSince: at(4001) }), null);
  assert.match(coverOf({ ...good, owedSince: at(4000) })!.text, /bregma-gateway for 1.0 s/);
  const slept = { timer_ms: 4999, wall_ms: 1e9 - 60_000 };
  assert.match(coverOf({ ...good, owedSince: slept })!.text, /for 65 s/);
});

const cases: [string, Partial<CoverInput>, RegExp][] = [
  ["a lost context", { contextLost: true }, /graphics were reset/],
  ["a hidden tab", { hidden: true }, /not visible/],
  ["a page that was interrupted", { awake: false }, /since this page was interrupted/],
  ["an unknown clock", { gateway_ms: Number.NaN }, /since this page was interrupted/],
  ["no frame yet", { owedSince: null }, /No word/],
  ["no daemon", link({ presence: 0 }), /No daemon has been heard/],
  ["a silent daemon", link({ presence: 1, silent_ms: 2300 }), /Nothing heard for 2.3 s/],
  ["a silent daemon with a sentence", link({ presence: 1, text: "its host is unreachable" }), /unreachable/],
  ["a presence that is not known", link({ presence: 7 }), /No daemon/],
  ["no case", caseRecord({ state: 0 }), /Load a case/],
  ["no case server", caseRecord({ state: 1 }), /No case server/],
  ["a case that failed", caseRecord({ state: 4, text: "checksum of chunk 3" }), /chunk 3/],
  ["a case that is being loaded", { caseLoaded: false }, /Loading/],
  ["no navigation state", link({ last_state_ms: Number.NaN }), /not published one/],
  ["an old navigation state", link({ last_state_ms: 98_000 }), /2.0 s old/],
  ["a failure of the page", { failure: "A frame cannot be read." }, /cannot be read/],
];
for (const [name, change, text] of cases) {
  test(`${name} covers the picture and is named`, () => assert.match(coverOf({ ...good, ...change })!.text, text));
}

test("a scanner's slice is shown without a case, but not while one is on its way or the daemon is silent", () => {
  const alone = { ...good, ...link({ last_state_ms: Number.NaN }), caseLoaded: false, scannerSlice: true };
  assert.equal(coverOf({ ...alone, ...caseRecord({ state: 0 }) }), null);
  assert.match(coverOf({ ...alone, ...caseRecord({ state: 2 }) })!.text, /On its way/);
  assert.match(coverOf({ ...good, ...link({ presence: 1 }), ...caseRecord({ state: 0 }) })!.text, /Nothing heard/);
});

test("a case on its way states its progress", () => {
  assert.equal(coverOf({ ...good, ...caseRecord({ state: 2, fraction: 0.4 }), caseLoaded: false })!.fraction, 0.4);
});
