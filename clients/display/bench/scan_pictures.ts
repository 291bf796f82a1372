// Pictures of the page during ./dev demo face-scan: points that no registration places, points that an estimate places,
// and the guide at its plan.
//
//   node scan_pictures.mjs URL FOLDER
import type { App } from "../src/page/app.ts";
import { launchBrowser } from "../tests/support/browser.ts";
import { until } from "../tests/support/page_probe.ts";

declare const bregma: App; // in the page

const [url, folder] = process.argv.slice(2);
if (!url || !folder) {
  console.error("usage: node scan_pictures.mjs URL FOLDER");
  process.exit(2);
}
const kLimit_ms = 300_000;
const browser = await launchBrowser();
try {
  const page = await browser.newPage({ viewport: { width: 1440, height: 900 } });
  await page.goto(url);
  const scene = () =>
    page.evaluate(() => {
      const guide = bregma.scene?.followedTool?.shown.state;
      return {
        unplaced: bregma.scene?.unplaced.length ?? 0,
        points: bregma.scene?.captures.length ?? 0,
        by: bregma.scene?.placedBy ?? null,
        lateral_mm: guide?.lateral_deviation_mm ?? Number.NaN,
        arms: bregma.scene?.arms.length ?? 0,
      };
    });
  const picture = async (name: string, wanted: (s: Awaited<ReturnType<typeof scene>>) => boolean) => {
    // On a slow machine a pose can end while the picture is taken: then it is taken again.
    for (let attempt = 0; attempt < 50; ++attempt) {
      await until(scene, wanted, name, kLimit_ms);
      await page.screenshot({ path: `${folder}/${name}.png` });
      if (wanted(await scene())) return;
    }
    throw new Error(`${name}: the page did not stay so while the picture was taken`);
  };
  await page.getByRole("tab", { name: "Register" }).click();
  await picture("scan_unplaced", (s) => s.unplaced >= 25);
  await picture("scan_placed", (s) => s.by === "candidate" && s.points >= 150);
  await page.getByRole("tab", { name: "Guide" }).click();
  await picture("guide_at_plan", (s) => s.by === "accepted" && s.arms > 0 && s.lateral_mm < 5);
} finally {
  await browser.close();
}
