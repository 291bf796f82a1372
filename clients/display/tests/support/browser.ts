// Debian's Chromium, without a window, drawing with software: what every machine that runs the tests has.
import { existsSync, readFileSync } from "node:fs";
import { type Browser, chromium, type Page } from "playwright-core";

const kPrograms = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];

export async function launchBrowser(): Promise<Browser> {
  const executablePath = process.env.BREGMA_BROWSER ?? kPrograms.find((path) => existsSync(path));
  if (!executablePath) throw new Error("no Chromium: ./dev setup installs it");
  return chromium.launch({
    executablePath,
    args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  });
}

// A blank page with a script of tests/browser/pages in it.
export async function pageWith(browser: Browser, script: string): Promise<Page> {
  const page = await browser.newPage();
  page.on("pageerror", (error) => console.error(`in the page: ${error.message}`));
  await page.setContent("<!doctype html><title>test</title>");
  await page.addScriptTag({
    content: readFileSync(`${process.env.BREGMA_BUILD}/display_tests/pages/${script}.js`, "utf8"),
  });
  return page;
}
