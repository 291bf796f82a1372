// How old the pose was when it was drawn, and where the time went. Milliseconds; the gateway's clock where not stated.
import type { Frame } from "../state/frame.ts";
import type { Tool } from "../state/validity.ts";

export interface DrawTime {
  readonly glass_age_ms: number; // exposure to the end of the draw; NaN without a pose
  readonly daemon_ms: number; // exposure to publication: tracker, driver, DDS, daemon
  readonly gateway_ms: number; // publication to the frame's writing: DDS, gateway, waiting for the page
  readonly socket_ms: number; // to its arrival in the page
  readonly wait_ms: number; // arrival to the beginning of the draw: decoding, and the browser's schedule
  readonly draw_ms: number;
  readonly at_ms: number; // the page's timer
}

const kKept = 4000;

export class DrawTimes {
  readonly times: DrawTime[] = [];

  add(time: DrawTime): void {
    this.times.push(time);
    if (this.times.length > kKept) this.times.splice(0, kKept / 2);
  }

  // Of the last draws.
  summary(): { rate_hz: number; p50_ms: number } {
    const last = this.times.slice(-60);
    if (last.length < 2) return { rate_hz: Number.NaN, p50_ms: Number.NaN };
    const sorted = last.map((t) => t.draw_ms).sort((a, b) => a - b);
    const span_ms = last[last.length - 1].at_ms - last[0].at_ms;
    return { rate_hz: (1000 * (last.length - 1)) / span_ms, p50_ms: sorted[sorted.length >> 1] };
  }
}

export interface DrawMoments {
  readonly frame: Frame;
  readonly arrived_ms: number; // all three by the gateway's clock
  readonly began_ms: number;
  readonly ended_ms: number;
}

export function drawTime(m: DrawMoments, tool: Tool | null, at_ms: number): DrawTime {
  const published = tool?.published_ms ?? Number.NaN;
  return {
    glass_age_ms: m.ended_ms - (tool?.acquired_ms ?? Number.NaN),
    daemon_ms: published - (tool?.acquired_ms ?? Number.NaN),
    gateway_ms: m.frame.written_ms - published,
    socket_ms: m.arrived_ms - m.frame.written_ms,
    wait_ms: m.began_ms - m.arrived_ms,
    draw_ms: m.ended_ms - m.began_ms,
    at_ms,
  };
}
