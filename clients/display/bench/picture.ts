// The picture of README: the page while the probe is near its target.
//
//   node picture.mjs OUTPUT.png
import type { App } from "../src/page/app.ts";
import { launchBrowser } from "../tests/support/browser.ts";
import { until } from "../tests/support/page_probe.ts";
import { RealChain } from "../tests/support/real_chain.ts";

declare const bregma: App; // in the page

const output = process.argv[2];
if (!output) {
  console.error("usage: node picture.mjs OUTPUT.png");
  process.exit(2);
}
const build = process.env.BREGMA_BUILD;
const chain = new RealChain({
  bin: `${build}/bin`,
  page: `${build}/display`,
  caseFolder: process.env.BREGMA_CASE ?? "out/cases/colin27",
  domain: Number(process.env.BREGMA_DOMAIN ?? 77),
});
const browser = await launchBrowser();
try {
  const page = await browser.newPage({ viewport: { width: 1440, height: 900 } });
  await page.goto(await chain.start());
  // The depth is counted along the plan, also by a probe that lies beside the head.
  const near = () =>
    page.evaluate(() => {
      const state = bregma.scene?.followedTool?.shown.state;
      return !!state && state.lateral_deviation_mm < 3 && state.remaining_depth_mm > 0 && state.remaining_depth_mm < 12;
    });
  // On a slow machine a pose can end while the picture is taken: then it is taken again.
  let taken = false;
  for (let attempt = 0; attempt < 50 && !taken; ++attempt) {
    await until(near, (is) => is, "the probe near its target", 400_000);
    await page.screenshot({ path: output });
    taken = await near();
  }
  if (!taken) throw new Error("the probe did not stay near its target while the picture was taken");
} finally {
  await browser.close();
  await chain.stop();
}
