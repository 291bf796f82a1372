// What a test sees of the page: its picture and state, read in the page.
import type { Page } from "playwright-core";
import type { App } from "../../src/page/app.ts";
import { launchBrowser } from "./browser.ts";
import { FakeGateway } from "./fake_gateway.ts";

declare const bregma: App; // in the page

export interface OpenPage {
  readonly page: Page;
  readonly gateway: FakeGateway;
  readonly requests: string[];
  readonly errors: string[];
  close(): Promise<void>;
}

// Small, since it is drawn with software.
export async function openPage(prepare: (gateway: FakeGateway) => void = () => {}): Promise<OpenPage> {
  const gateway = new FakeGateway(`${process.env.BREGMA_BUILD}/display`);
  prepare(gateway);
  const url = await gateway.start();
  const browser = await launchBrowser();
  const page = await browser.newPage({ viewport: { width: 1000, height: 640 } });
  const requests: string[] = [];
  const errors: string[] = [];
  page.on("request", (r) => requests.push(r.url()));
  page.on("pageerror", (e) => errors.push(e.message));
  await page.goto(url);
  const close = async () => {
    await browser.close();
    await gateway.stop();
  };
  return { page, gateway, requests, errors, close };
}

export async function until<T>(
  read: () => Promise<T>,
  wanted: (value: T) => boolean,
  what: string,
  limit_ms = 20_000,
): Promise<T> {
  const end = performance.now() + limit_ms;
  for (;;) {
    const value = await read();
    if (wanted(value)) return value;
    if (performance.now() > end) throw new Error(`${what}: still ${JSON.stringify(value)} after ${limit_ms} ms`);
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
}

export const toolsShown = (page: Page) => page.evaluate(() => bregma.scene?.tools.length ?? 0);
export const coverTitle = (page: Page) =>
  page.evaluate(() => document.querySelector(".cover:not([hidden]) h1")?.textContent ?? "");

export const untilTool = (page: Page) =>
  until(
    () => toolsShown(page),
    (n) => n > 0,
    "a tool is shown",
  );
export const untilCover = (page: Page, title: string) =>
  until(
    () => coverTitle(page),
    (t) => t === title,
    `the cover "${title}"`,
  );
export const untilPicture = (page: Page) =>
  until(
    () => coverTitle(page),
    (t) => t === "",
    "the picture",
  );

// Waits until the page has drawn what changed.
export async function drawn(page: Page): Promise<void> {
  const before = await page.evaluate(() => bregma.times.times.length);
  await until(
    () => page.evaluate(() => bregma.times.times.length),
    (n) => n !== before,
    "another draw",
  );
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
}

// Pixels of a panel in a colour of the lines (the overlay, or the picture below it).
export function countColour(
  page: Page,
  canvas: "picture" | "overlay",
  css: string,
  panel: number | null = null,
): Promise<number> {
  return page.evaluate(
    ([which, colour, index]) => {
      const element = document.querySelectorAll<HTMLCanvasElement>(".picture > canvas")[which === "picture" ? 0 : 1];
      const rect =
        index === null
          ? { x: 0, y: 0, width: element.width, height: element.height }
          : bregma.display.rectOf(index as number)!;
      const copy = document.createElement("canvas");
      copy.width = rect.width;
      copy.height = rect.height;
      const c = copy.getContext("2d")!;
      c.drawImage(element, -rect.x, -rect.y);
      const { data } = c.getImageData(0, 0, rect.width, rect.height);
      const value = Number.parseInt((colour as string).slice(1), 16);
      const wanted = [value >> 16, (value >> 8) & 255, value & 255];
      let count = 0;
      for (let i = 0; i < data.length; i += 4) {
        if (data[i + 3] > 200 && wanted.every((w, d) => Math.abs(w - data[i + d]) <= 12)) ++count;
      }
      return count;
    },
    [canvas, css, panel] as const,
  );
}

// Red pixels of a panel's picture, bright or in shade.
export function countRed(page: Page, panel: number): Promise<number> {
  return page.evaluate((index) => {
    const rect = bregma.display.rectOf(index)!;
    const copy = document.createElement("canvas");
    copy.width = rect.width;
    copy.height = rect.height;
    const c = copy.getContext("2d")!;
    c.drawImage(document.querySelector<HTMLCanvasElement>(".picture > canvas")!, -rect.x, -rect.y);
    const { data } = c.getImageData(0, 0, rect.width, rect.height);
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (data[i] > 80 && data[i] > 2.5 * data[i + 1] && data[i] > 2.5 * data[i + 2]) ++count;
    }
    return count;
  }, panel);
}

// A number that changes with the picture of a panel.
export function panelSum(page: Page, panel: number): Promise<number> {
  return page.evaluate((index) => {
    const rect = bregma.display.rectOf(index)!;
    const copy = document.createElement("canvas");
    copy.width = rect.width;
    copy.height = rect.height;
    const c = copy.getContext("2d")!;
    c.drawImage(document.querySelector<HTMLCanvasElement>(".picture > canvas")!, -rect.x, -rect.y);
    const { data } = c.getImageData(0, 0, rect.width, rect.height);
    let sum = 0;
    for (let i = 0; i < data.length; i += 4)
      sum = (sum * 31 + data[i] + 7 * data[i + 1] + 13 * data[i + 2]) % 2147483647;
    return sum;
  }, panel);
}

// Position on the page of a point of Image in a panel.
export function pixelOf(page: Page, panel: number, point: readonly number[]): Promise<{ x: number; y: number }> {
  return page.evaluate(
    ([index, p]) => {
      const pen = bregma.display.penOf(index as number, bregma.view, bregma.scene!)!;
      const { x, y } = pen.pixel(p as [number, number, number]);
      const box = bregma.display.element.getBoundingClientRect();
      return { x: x + box.left, y: y + box.top };
    },
    [panel, point] as const,
  );
}

export const cursorOf = (page: Page) => page.evaluate(() => [...bregma.view.cursor]);

export const textOf = async (page: Page, selector: string): Promise<string> =>
  (await page.locator(selector).textContent()) ?? "";
