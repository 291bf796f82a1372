// Elements with attributes and children in one call.
type Child = Node | string | null | undefined | false;
type Attributes = Readonly<Record<string, string | number | boolean | ((event: Event) => void) | undefined>>;

export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: readonly Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== undefined) element.setAttribute(name, String(value));
  }
  element.append(...(children.filter((c) => c !== null && c !== undefined && c !== false) as (Node | string)[]));
  return element;
}

// Writes only what has changed, so that an unchanged page costs nothing.
export function setText(element: HTMLElement, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

export function setClass(element: HTMLElement, name: string, on: boolean): void {
  if (element.classList.contains(name) !== on) element.classList.toggle(name, on);
}

// Replaces the rows of a table, or anything else, when `key` has changed.
export function fill(element: HTMLElement, key: string, children: () => readonly Child[]): void {
  if (element.dataset.key === key) return;
  element.dataset.key = key;
  element.replaceChildren(...(children().filter((c) => c) as (Node | string)[]));
}

export interface Column {
  readonly title: string;
  readonly number?: boolean;
}

export function table(
  columns: readonly Column[],
  rows: readonly (readonly Child[])[],
  mark: (row: number) => string = () => "",
): HTMLElement {
  const kind = (c: number) => (columns[c].number ? "number" : "");
  return h(
    "table",
    {},
    h("thead", {}, h("tr", {}, ...columns.map((c, i) => h("th", { class: kind(i) }, c.title)))),
    h(
      "tbody",
      {},
      ...rows.map((row, r) => h("tr", { class: mark(r) }, ...row.map((cell, c) => h("td", { class: kind(c) }, cell)))),
    ),
  );
}
