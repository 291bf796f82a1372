// Where the panels are. Rectangles in CSS pixels from the upper left corner of the picture.
export type Layout = "2x2" | "1+3" | "one";

export interface Rect {
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
}

const kGap = 4;

// Rectangles of the four panels; null for one that is not shown. `big` is the panel that layouts 1+3 and one enlarge.
export function panelRects(layout: Layout, big: number, width: number, height: number): (Rect | null)[] {
  if (layout === "one") return [0, 1, 2, 3].map((i) => (i === big ? whole(0, 0, width, height) : null));
  if (layout === "2x2") {
    const w = (width - kGap) / 2;
    const h = (height - kGap) / 2;
    return [0, 1, 2, 3].map((i) => whole((i % 2) * (w + kGap), i < 2 ? 0 : h + kGap, w, h));
  }
  const h = (height - 2 * kGap) / 3;
  const small = Math.min(h * 1.2, width / 3);
  let row = 0;
  return [0, 1, 2, 3].map((i) =>
    i === big ? whole(0, 0, width - small - kGap, height) : whole(width - small, row++ * (h + kGap), small, h),
  );
}

const whole = (x: number, y: number, width: number, height: number): Rect => ({
  x: Math.round(x),
  y: Math.round(y),
  width: Math.max(1, Math.floor(width)),
  height: Math.max(1, Math.floor(height)),
});

export const within = (rect: Rect, x: number, y: number): boolean =>
  x >= rect.x && x < rect.x + rect.width && y >= rect.y && y < rect.y + rect.height;
