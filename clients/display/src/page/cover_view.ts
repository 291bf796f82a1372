// The cover over the picture, with its reason.
import type { Cover } from "../state/cover.ts";
import { h, setText } from "./dom.ts";

export class CoverView {
  private readonly title = h("h1");
  private readonly text = h("p");
  private readonly progress = h("progress", { max: 1 });
  readonly element = h("div", { class: "cover", role: "status" }, this.title, this.text, this.progress);

  show(cover: Cover | null): void {
    this.element.hidden = cover === null;
    if (!cover) return;
    setText(this.title, cover.title);
    setText(this.text, cover.text);
    this.progress.hidden = cover.fraction === undefined;
    if (cover.fraction !== undefined) this.progress.value = cover.fraction;
  }
}
