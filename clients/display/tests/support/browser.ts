// Debian's Chromium, without a window, drawing with software: what every machine that runs the tests has.
import { existsSync, readFileSync } from "node:fs";
import { type Browser, type BrowserContext, chromium, type Page } from "playwright-core";

const kPrograms = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];

function options(program?: string) {
  const executablePath = program ?? process.env.BREGMA_BROWSER ?? kPrograms.find((path) => existsSync(path));
  if (!executablePath) throw new Error("no Chromium: ./dev setup installs it");
  const args = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
  return { executablePath, args };
}

// program: instead of the one that is installed.
export const launchBrowser = (program?: string): Promise<Browser> => chromium.launch(options(program));

// With further arguments, and a folder for all that it keeps.
export function launchWithProfile(folder: string, args: string[]): Promise<BrowserContext> {
  const { executablePath, args: always } = options();
  return chromium.launchPersistentContext(folder, { executablePath, args: [...always, ...args] });
}

// With the id of its process, for measurements.
export async function launchServer(): Promise<{ browser: Browser; pid: number; close(): Promise<void> }> {
  const server = await chromium.launchServer(options());
  const browser = await chromium.connect(server.wsEndpoint());
  return { browser, pid: server.process().pid ?? 0, close: () => server.close() };
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
