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
  const left = () => page.evaluate(() => bregma.scene?.followedTool?.shown.state.remaining_depth_mm ?? Number.NaN);
  await until(left, (mm) => mm < 12 && mm > 0, "the probe near its target", 400_000);
  // On a slow machine a pose can end while the picture is taken: then it is taken again.
  const shown = () => page.evaluate(() => bregma.draws * (bregma.scene?.tools.length ? 1 : 0));
  for (let attempt = 0; attempt < 50; ++attempt) {
    const before = await shown();
    await page.screenshot({ path: output });
    if (before > 0 && (await shown()) > 0) break;
  }
} finally {
  await browser.close();
  await chain.stop();
}
