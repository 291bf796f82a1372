import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { GatewayClock } from "../../src/state/clock.ts";
import { decodeFrame, kHeaderBytes } from "../../src/state/frame.ts";
import { kLayouts, type RecordName } from "../../src/state/layout.ts";
import { Store } from "../../src/state/store.ts";
import { hasPose, remaining_ms, shownTool, type Tool } from "../../src/state/validity.ts";
import { encodeFrame, liveTool, record, recordBytes } from "../support/frames.ts";
import { Random } from "../support/random.ts";

test("the table of records is that of docs/gateway.md", () => {
  const page = readFileSync(`${process.env.BREGMA_SOURCE}/docs/gateway.md`, "utf8");
  const stated = new Map<string, string>();
  for (const section of page.split("\n### ").slice(1)) {
    const [, number, name] = /^(\d+) (\w+)/.exec(section)!;
    const fields: Record<string, [number, string]> = {};
    const keys: string[] = [];
    for (const [, offset, type, field] of section.matchAll(/^\| (\d+) \| ([\w[\]]+) \| (\**\w+\**) \|/gm)) {
      const plain = field.replaceAll("*", "");
      if (plain === "reserved") continue;
      fields[plain] = [Number(offset), type];
      if (field !== plain) keys.push(plain);
    }
    stated.set(name, JSON.stringify({ kind: Number(number), keys, fields }));
  }
  assert.deepEqual([...stated.keys()], Object.keys(kLayouts));
  for (const [name, layout] of stated) assert.equal(JSON.stringify(kLayouts[name as RecordName]), layout, name);
});

test("a frame is decoded as it was encoded", () => {
  const tool = liveTool(1000);
  const frame = decodeFrame(
    encodeFrame(42, 1234.5, [
      record("tool", tool),
      record("alarm", { alarm: "drift", subject: "Ünïcode", severity: 3 }),
    ]),
  );
  assert.equal(frame.number, 42);
  assert.equal(frame.written_ms, 1234.5);
  assert.deepEqual(frame.records[0].value, tool);
  assert.equal(frame.records[0].key, "Probe");
  assert.equal(frame.records[1].key, "drift\nÜnïcode");
});

test("unknown records and further fields are skipped", () => {
  const encoded = encodeFrame(1, 0, [
    { name: "health", value: { recorded: 5 }, tail: new Uint8Array(16) },
    record("loop", { loop: "navigation" }),
  ]);
  new DataView(encoded).setUint16(kHeaderBytes + recordBytes("health") + 16, 999, true);
  const frame = decodeFrame(encoded);
  assert.deepEqual(
    frame.records.map((r) => r.name),
    ["health"],
  );
});

test("the arrays of a field record are read", () => {
  const tail = new Uint8Array(new Float32Array([1, 2, 3, 4, 5, 6, 700, 800]).buffer);
  const encoded = encodeFrame(1, 0, [{ name: "field", value: { model: "brain", nodes: 2, stresses: 2 }, tail }]);
  const [field] = decodeFrame(encoded).records;
  assert.deepEqual([...field.arrays!.displacement_mm], [1, 2, 3, 4, 5, 6]);
  assert.deepEqual([...field.arrays!.von_mises_Pa], [700, 800]);
});

test("damaged frames are refused with a sentence", () => {
  const good = () => encodeFrame(1, 0, [record("loop", { loop: "navigation" })]);
  const damaged = (change: (view: DataView) => void) => {
    const buffer = good();
    change(new DataView(buffer));
    return () => decodeFrame(buffer);
  };
  assert.throws(
    damaged((v) => v.setUint32(0, 1, true)),
    /not a frame of bregma-gateway/,
  );
  assert.throws(
    damaged((v) => v.setUint16(4, 0, true)),
    /layout 0/,
  );
  assert.throws(
    damaged((v) => v.setUint32(12, 9, true)),
    /states 9/,
  );
  assert.throws(
    damaged((v) => v.setUint16(6, 3, true)),
    /record 1 begins beyond the frame/,
  );
  assert.throws(
    damaged((v) => v.setUint32(28, 4096, true)),
    /record 0 states 4096 bytes/,
  );
  assert.throws(() => decodeFrame(new ArrayBuffer(3)), /shorter than its header/);
});

test("an ended instance is removed", () => {
  const store = new Store();
  store.apply(
    decodeFrame(encodeFrame(1, 0, [record("tool", liveTool(0)), record("tool", { ...liveTool(0), tool: "Stylus" })])),
  );
  assert.equal(store.all("tool").length, 2);
  store.apply(decodeFrame(encodeFrame(2, 0, [record("tool", { tool: "Probe" }, true)])));
  assert.deepEqual(
    store.all("tool").map((t) => t.tool),
    ["Stylus"],
  );
});

test("a pose ends at its time, and 300 ms after its exposure at the latest", () => {
  const tool = liveTool(1000);
  assert.ok(remaining_ms(tool, 1089.9) > 0);
  assert.equal(remaining_ms(tool, 1090), 0);
  const generous = { ...tool, valid_until_ms: 1e9 };
  assert.ok(remaining_ms(generous, 1291.9) > 0);
  assert.equal(remaining_ms(generous, 1292), 0);
  assert.equal(remaining_ms(tool, Number.NaN), 0);
  assert.equal(remaining_ms({ ...tool, acquired_ms: Number.NaN }, 1000), 0);
  assert.equal(remaining_ms({ ...tool, valid_until_ms: Number.NaN }, 1000), 0);
});

// What the rule of idl/validity.hpp says, written independently of the page's code.
function mayBeDrawn(tool: Tool, now_ms: number): boolean {
  if (tool.status !== 1 && tool.status !== 2) return false;
  if (![0, 1, 2].includes(tool.plausibility)) return false;
  const numbers = [...tool.rotation, ...tool.tip_mm, tool.tre_rms_mm, ...tool.tre_95_semi_axes_mm];
  if (numbers.some((n) => !Number.isFinite(n))) return false;
  return now_ms < tool.valid_until_ms && now_ms - tool.acquired_ms < 300;
}

test("10^6 states: what may be drawn is drawn, nothing else, and unverified as such", () => {
  const random = new Random(20);
  const now = 5_000_000;
  const buffer = encodeFrame(1, now, [record("tool", liveTool(now))]);
  const view = new DataView(buffer);
  const fields = kLayouts.tool.fields;
  const at = (field: string, element = 0) => kHeaderBytes + fields[field][0] + 8 * element;
  const doubles = ["rotation", "tip_mm", "tre_rms_mm", "tre_95_semi_axes_mm", "acquired_ms", "valid_until_ms"];
  const lengths = [9, 3, 1, 3, 1, 1];
  const bad = [Number.NaN, Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
  let drawn = 0;
  for (let k = 0; k < 1_000_000; ++k) {
    const age = random.between(0, 99);
    view.setFloat64(at("acquired_ms"), now - age, true);
    view.setFloat64(at("published_ms"), now - age / 2, true);
    view.setFloat64(at("valid_until_ms"), now - age + 100, true);
    const status = random.uniform() < 0.5 ? 1 : 2;
    view.setInt32(at("status"), status, true);
    view.setInt32(at("plausibility"), random.integer(3), true);
    let undo = () => {};
    if (random.uniform() < 0.5) {
      switch (random.integer(5)) {
        case 0: // another status, known or not
          view.setInt32(at("status"), [0, 3, 4, 5, 6, 7, 8, 9, 10, 255, -1, 1 << 20][random.integer(12)], true);
          break;
        case 1:
          view.setInt32(at("plausibility"), [3, 4, 77, -1][random.integer(4)], true);
          break;
        case 2: {
          const f = random.integer(doubles.length);
          const where = at(doubles[f], random.integer(lengths[f]));
          const before = view.getFloat64(where, true);
          view.setFloat64(where, doubles[f].endsWith("_ms") ? Number.NaN : bad[random.integer(3)], true);
          undo = () => view.setFloat64(where, before, true);
          break;
        }
        case 3: // over
          view.setFloat64(at("valid_until_ms"), now - random.between(0, 1e6), true);
          break;
        case 4: // older than any pose may be, whatever is stated
          view.setFloat64(at("acquired_ms"), now - random.between(300, 1e6), true);
          view.setFloat64(at("valid_until_ms"), now + 1e6, true);
          break;
      }
    }
    const tool = decodeFrame(buffer).records[0].value as Tool;
    const shown = shownTool(tool, now);
    assert.equal(shown !== null, mayBeDrawn(tool, now), JSON.stringify(tool));
    if (shown) {
      ++drawn;
      assert.equal(shown.verified, tool.status === 1);
    }
    undo();
  }
  assert.ok(drawn > 480_000 && drawn < 520_000, `${drawn} drawn`);
});

test("a state without a pose has none, also with numbers in it", () => {
  for (let status = -3; status < 300; ++status) {
    assert.equal(hasPose({ ...liveTool(0), status }), status === 1 || status === 2);
  }
});

const local = (timer_ms: number, wall_ms = timer_ms + 1e9) => ({ timer_ms, wall_ms });

function exchange(sent: number, received: number, arrived: number, wallAhead = 1e9) {
  return {
    sent: local(sent, sent + wallAhead),
    received_ms: received,
    written_ms: received,
    arrived: local(arrived, arrived + wallAhead),
  };
}

test("the gateway's clock follows the exchange with the shortest round trip", () => {
  const clock = new GatewayClock();
  assert.ok(Number.isNaN(clock.at(local(0))));
  clock.add(exchange(0, 5020, 30)); // 15 ms wrong
  clock.add(exchange(100, 5101, 102));
  clock.add(exchange(200, 5230, 240));
  assert.equal(clock.at(local(300)), 5300);
  assert.equal(clock.round_trip_ms, 2);
});

test("a sleep in which the timer stood still ends every pose", () => {
  const clock = new GatewayClock();
  clock.add(exchange(0, 5001, 2));
  const tool = { ...liveTool(5001), valid_until_ms: 5100 };
  assert.ok(shownTool(tool, clock.at(local(10))));
  const woken = { timer_ms: 20, wall_ms: 20 + 1e9 + 10_000 }; // ten seconds later
  assert.equal(shownTool(tool, clock.at(woken)), null);
  assert.equal(clock.step_ms(woken), 10_000);
});

test("a wall clock that is set back prolongs nothing", () => {
  const clock = new GatewayClock();
  clock.add(exchange(0, 5001, 2));
  const later = { timer_ms: 200, wall_ms: 200 + 1e9 - 3_600_000 };
  assert.equal(clock.at(later), 5200);
});

test("an exchange across a step is not used, and one after it makes the earlier ones void", () => {
  const clock = new GatewayClock();
  clock.add(exchange(0, 5001, 2));
  const across = { ...exchange(100, 5101, 102), arrived: local(102, 102 + 1e9 + 10_000) };
  assert.equal(clock.add(across), false);
  assert.equal(clock.add(exchange(200, 15_210, 220, 1e9 + 10_000)), true); // longer round trip, but the only one since
  assert.equal(clock.at(local(300, 300 + 1e9 + 10_000)), 15_300);
});
