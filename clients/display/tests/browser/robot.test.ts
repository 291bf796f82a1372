// A robot that scans a face: its points before and after a registration places them, and the arm while its tool is live.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import type { App } from "../../src/page/app.ts";
import type { RecordOf } from "../../src/state/layout.ts";
import { kColours } from "../../src/view/colours.ts";
import { insertion } from "../support/fake_gateway.ts";
import { countColour, drawn, type OpenPage, openPage, textOf, until } from "../support/page_probe.ts";

declare const bregma: App; // in the page

let open: OpenPage;
const kSpace = 3;
const kAxial = 0;
const kIdentity = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const kUnknown = new Array<number>(9).fill(Number.NaN);
const kShift_mm = 200; // of the arm's base from the image, along x

const guide = (now: number, change: Partial<RecordOf<"tool">> = {}): Partial<RecordOf<"tool">> => ({
  ...insertion(now, 0.1),
  tool: "Guide",
  source_kind: 2,
  valid_until_ms: now + 290,
  ...change,
});

before(async () => {
  open = await openPage((gateway) => {
    gateway.tool = (now) => guide(now, { status: 8 }); // not registered
    for (const [i, angle] of [-0.4, -0.2, 0, 0.2, 0.4].entries()) {
      const radius = 88 + i - 2; // 2 mm inside to 2 mm outside
      const position_mm = [radius * Math.sin(angle) - kShift_mm, radius * Math.cos(angle), 0];
      gateway.set("capture", { tool: "Range", ordinal: i, kind: 2, position_mm }, `${i}`);
    }
  });
  await until(
    () => open.page.evaluate(() => bregma.scene?.unplaced.length ?? 0),
    (n) => n === 5,
    "points without a registration",
  );
  await open.page.evaluate(() => {
    bregma.view.setCursor([0, 0, 0]);
    bregma.changed();
  });
  await drawn(open.page);
});
after(() => open?.close());

const register = (change: Partial<RecordOf<"registration">>) =>
  open.gateway.set("registration", {
    reference: "RobotBase",
    status: 3,
    rotation: kIdentity,
    translation_mm: [kShift_mm, 0, 0],
    accepted_rotation: kUnknown,
    accepted_translation_mm: kUnknown.slice(0, 3),
    ...change,
  });
const placedBy = (wanted: string) =>
  until(
    () => open.page.evaluate(() => bregma.scene?.placedBy ?? ""),
    (by) => by === wanted,
    `points placed by ${wanted}`,
  );
const unverified = (panel: number) => countColour(open.page, "overlay", kColours.unverified, panel);

test("points that no registration places are shown beside the image, with the reason, and in no slice", async () => {
  assert.ok((await countColour(open.page, "overlay", kColours.unknown, kSpace)) >= 5 * 4);
  assert.ok((await unverified(kSpace)) > 100, "the reason");
  assert.equal(await countColour(open.page, "overlay", kColours.unknown, kAxial), 0);
  await open.page.getByRole("tab", { name: "Register" }).click();
  await drawn(open.page);
  const page = await textOf(open.page, "#registration-page");
  assert.match(page, /5 points in Reference: not registered to the image yet/);
  assert.doesNotMatch(page, /Touch fiducial/, "a scan needs none");
});

test("an estimate places them, coloured by their signed distance; it says that it is not accepted", async () => {
  register({});
  await placedBy("candidate");
  await drawn(open.page);
  const mm = await open.page.evaluate(() => bregma.scene!.captures.map((c) => c.distance_mm));
  assert.ok(
    mm.every((d, i) => Math.abs(d - (i - 2)) < 0.5),
    `${mm}`,
  );
  assert.match(await textOf(open.page, "#registration-page"), /\(\+ is outside\)/);
  const said = [await unverified(kSpace), await unverified(kAxial)];
  register({ status: 4, accepted_rotation: kIdentity, accepted_translation_mm: [kShift_mm, 0, 0] });
  await placedBy("accepted");
  await drawn(open.page);
  assert.ok(said.every((count) => count > 100));
  assert.deepEqual([await unverified(kSpace), await unverified(kAxial)], [0, 0]);
});

test("the arm is drawn while the pose of its tool is live, orange while it is not verified, and not after that", async () => {
  const inPicture = (css: string) => countColour(open.page, "picture", css, kSpace);
  const names = (css: string) => countColour(open.page, "overlay", css, kSpace);
  assert.deepEqual([await names(kColours.live), await inPicture(kColours.live)], [0, 0]);
  open.gateway.tool = (now) => guide(now);
  const arm = await until(
    () =>
      open.page.evaluate(
        () => bregma.scene?.arms.map((a) => ({ flange: a.flange, base: a.base, tip: a.tool.tip })) ?? [],
      ),
    (arms) => arms.length === 1,
    "the arm",
  );
  assert.deepEqual(arm[0].base, [kShift_mm, 0, 0]);
  assert.ok(Math.abs(Math.hypot(...arm[0].flange.map((x, d) => x - arm[0].tip[d])) - 60) < 1e-6);
  open.gateway.tool = (now) => guide(now, { status: 2 });
  await until(
    () => open.page.evaluate(() => bregma.scene?.arms[0]?.tool.verified ?? true),
    (verified) => !verified,
    "an arm that is not verified",
  );
  open.gateway.frozen = true; // nothing new: the last pose ends at its time
  await until(
    () => open.page.evaluate(() => bregma.scene?.arms.length ?? 0),
    (n) => n === 0,
    "no arm is shown",
  );
  for (const css of [kColours.live, kColours.unverified]) {
    assert.deepEqual([await names(css), await inPicture(css)], [0, 0]);
  }
  assert.deepEqual(open.errors, []);
});
