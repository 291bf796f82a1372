// Health of the system: devices, loops, recorder, connection.

import { DeviceStatus } from "../state/constants.ts";
import type { RecordOf } from "../state/layout.ts";
import type { StateLink } from "../state/link.ts";
import { deviceText, driverText, figure } from "../state/text.ts";
import type { CaselessPart, StateContext } from "./context.ts";
import { fill, h, table } from "./dom.ts";

export interface DrawTimes {
  readonly rate_hz: number;
  readonly p50_ms: number;
}

export class HealthPage implements CaselessPart {
  private readonly devices = h("div");
  private readonly loops = h("div");
  private readonly rows = h("dl", { class: "pairs" });
  readonly element = h(
    "section",
    { class: "page", id: "health-page" },
    h("h2", {}, "System"),
    this.rows,
    h("h3", {}, "Devices"),
    this.devices,
    h("h3", {}, "Loops"),
    this.loops,
  );

  constructor(
    private readonly link: StateLink,
    private readonly times: () => DrawTimes,
  ) {}

  update({ store, gateway_ms }: StateContext): void {
    const health = store.all("health")[0];
    const link = store.all("link")[0];
    const { rate_hz, p50_ms } = this.times();
    const pairs: [string, string][] = [
      ["Daemon", link ? `${link.host}, wire ${link.wire_generation}.${link.wire_revision}` : "–"],
      ["Running since", health ? figure((gateway_ms - health.started_ms) / 60000, 0, "min") : "–"],
      [
        "Recorded",
        health
          ? `${health.recorded} samples, ${health.record_dropped} lost${health.recorder_failing ? ", FAILING" : ""}`
          : "–",
      ],
      ["Memory", health ? figure(health.resident_bytes / 2 ** 20, 0, "MiB") : "–"],
      ["Wall clock", health ? `error ${figure(health.clock_error_ms, 1, "ms")}, ${health.clock_steps} steps` : "–"],
      ["Other wire versions", String(health?.other_wire ?? "–")],
      [
        "This page",
        `${figure(rate_hz, 0, "Hz")}, draw ${figure(p50_ms, 0, "ms")}, round trip ${figure(this.link.clock.round_trip_ms, 1, "ms")}`,
      ],
    ];
    fill(this.rows, pairs.flat().join("|"), () =>
      pairs.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]),
    );
    fill(this.devices, `${store.revision("device")}`, () => [deviceTable(store.all("device"))]);
    fill(this.loops, `${store.revision("loop")}`, () => [loopTable(store.all("loop"))]);
  }
}

function deviceTable(all: readonly RecordOf<"device">[]): HTMLElement {
  const columns = ["", "", "Hz", "age ms", "99 % ms", "lost", "late", "refused"].map((title, i) => ({
    title,
    number: i > 1,
  }));
  return table(columns, all.map(deviceRow), (r) => (all[r].status === DeviceStatus.LIVE ? "" : "bad"));
}

function deviceRow(d: RecordOf<"device">): string[] {
  const driver = driverText(d.driver_state);
  return [
    d.device,
    driver && d.driver_state !== 2 ? `${deviceText(d.status)}, ${driver}` : deviceText(d.status),
    figure(d.rate_hz, 0),
    figure(d.age_ms, 0),
    figure(d.latency_p99_ms, 1),
    figure(d.lost, 0),
    figure(d.late, 0),
    figure(d.rejected, 0),
  ];
}

function loopTable(loops: readonly RecordOf<"loop">[]): HTMLElement {
  const columns = ["", "Hz", "50 % µs", "99 % µs", "max µs", "overruns"].map((title, i) => ({ title, number: i > 0 }));
  return table(
    columns,
    loops.map((l) => [
      l.loop,
      l.rate_hz > 0 ? figure(l.rate_hz, 0) : "events",
      figure(l.step_p50_us, 0),
      figure(l.step_p99_us, 0),
      figure(l.step_max_us, 0),
      figure(l.overruns, 0),
    ]),
    (r) => (loops[r].overruns > 0 ? "warn" : ""),
  );
}
