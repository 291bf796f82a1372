// A picture of the page as it is: the panels, with time, case, session, figures, alarms and measurements burned in.
import { distance } from "../geometry/vector.ts";
import { figure } from "../state/text.ts";
import type { Display } from "../view/display.ts";
import type { ViewState } from "../view/view_state.ts";

export interface ScreenshotInput {
  readonly display: Display;
  readonly view: ViewState;
  readonly title: string; // case, side, session
  readonly lines: readonly string[]; // figures and alarms
}

const kLine_px = 22;

export async function screenshotOf(input: ScreenshotInput): Promise<Blob> {
  const { clientWidth: width, clientHeight: height } = input.display.element;
  const measured = input.view.measurements.map(
    (m, i) => `Distance ${i + 1}: ${figure(distance(m.from, m.to), 1, "mm")}`,
  );
  const lines = [`${new Date().toISOString()}  ·  ${input.title}`, ...input.lines, ...measured];
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height + kLine_px * lines.length + 12;
  const c = canvas.getContext("2d") as CanvasRenderingContext2D;
  c.fillStyle = "#000";
  c.fillRect(0, 0, canvas.width, canvas.height);
  c.fillStyle = "#e9eff5";
  c.font = '16px system-ui, "DejaVu Sans", sans-serif';
  c.textBaseline = "middle";
  lines.forEach((line, i) => {
    c.fillText(line, 10, 6 + kLine_px * (i + 0.5), width - 20);
  });
  input.display.copyTo(c, 0, kLine_px * lines.length + 12);
  const blob = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!blob) throw new Error("the browser made no picture");
  return blob;
}

export function save(blob: Blob, name: string): void {
  const url = URL.createObjectURL(blob);
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
