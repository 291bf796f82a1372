// What the page showed and when, written down by the page itself, so that a test's own delays do not count.
import assert from "node:assert/strict";
import type { Page } from "playwright-core";
import type { App } from "../../src/page/app.ts";

declare const bregma: App; // in the page

export interface Look {
  readonly at_ms: number; // Date.now()
  readonly tools: number; // shown
  readonly over_ms: number; // by which the shown pose that ended first is over; negative: it is not
  readonly cover: string;
}

export interface GlassLog {
  readonly looks: readonly Look[];
  readonly draw_ms: number; // the longest draw
  readonly pause_ms: number; // the longest time in which the page itself did not run
}

const kLook_ms = 5;
const kMaxAge_ms = 300;

type Watched = { glassLooks: Look[] };

export const startLog = (page: Page): Promise<void> =>
  page.evaluate(
    ([period, maxAge]) => {
      const looks: Look[] = [];
      (globalThis as unknown as Watched).glassLooks = looks;
      setInterval(() => {
        const now = bregma.link.now_ms();
        const shown = document.hidden || bregma.cover ? [] : (bregma.scene?.tools ?? []);
        const ends = shown.map(({ shown: { state } }) => Math.min(state.valid_until_ms, state.acquired_ms + maxAge));
        looks.push({
          at_ms: Date.now(),
          tools: shown.length,
          over_ms: now - Math.min(...ends),
          cover: bregma.cover?.title ?? "",
        });
      }, period);
    },
    [kLook_ms, kMaxAge_ms] as const,
  );

export async function takeLog(page: Page): Promise<GlassLog> {
  const { looks, draws } = await page.evaluate(() => ({
    looks: (globalThis as unknown as Watched).glassLooks.splice(0),
    draws: bregma.times.times.map((t) => t.draw_ms),
  }));
  const pauses = looks.slice(1).map((look, i) => look.at_ms - looks[i].at_ms);
  return { looks, draw_ms: Math.max(0, ...draws), pause_ms: Math.max(0, ...pauses) };
}

// No pose was on the glass for longer than its limit and the draw that removed it. A pause of the page, as on a machine
// that is busy otherwise, comes on top: nothing can be drawn in it. Returns the longest time over the limit.
export function assertGoneInTime(log: GlassLog): number {
  const over = Math.max(0, ...log.looks.filter((look) => look.tools > 0).map((look) => look.over_ms));
  const allowed = log.draw_ms + log.pause_ms + 2 * kFrame_ms;
  assert.ok(over <= allowed, `a pose was shown ${over} ms beyond its limit, allowed: ${allowed}`);
  return over;
}

const kFrame_ms = 17; // of the screen: a draw begins with one

// After `resumed_ms`, shown again within a second of the first valid state that another client received, not counting the
// pauses of the page: a busy machine makes many. Returns the time with them; negative: the page was the first.
export function assertBackInTime(log: GlassLog, resumed_ms: number, valid_ms: number): number {
  const back = log.looks.findIndex((look) => look.at_ms >= resumed_ms && look.tools > 0);
  assert.ok(back >= 0, "the probe did not come back");
  const took = log.looks[back].at_ms - valid_ms;
  let paused = 0;
  for (let i = back; i > 0 && log.looks[i].at_ms > valid_ms; --i) {
    paused += Math.max(0, log.looks[i].at_ms - log.looks[i - 1].at_ms - kFrame_ms);
  }
  const allowed = 1000 + log.draw_ms + paused;
  assert.ok(took <= allowed, `${took} ms after the first valid state, allowed: ${allowed}`);
  return took;
}
