// The tone of alarms. A browser plays sound only after the first click or key on the page, unless it was started
// otherwise, as that of a display on the whole screen is (deploy/bregma-kiosk.service).
const kRepeat_ms = 4000;

export class Tone {
  on = true;
  private readonly context = new AudioContext();
  private timer: ReturnType<typeof setInterval> | null = null;

  // Whether a tone could be heard now.
  get ready(): boolean {
    return this.context.state === "running";
  }

  // To be called from a click or key.
  unlock(): void {
    void this.context.resume();
  }

  play(critical: boolean): void {
    const context = this.context;
    if (!this.on || !this.ready) return; // what could not be heard now is not played later
    const beeps = critical ? [880, 660, 880] : [660];
    beeps.forEach((frequency, i) => {
      const from = context.currentTime + 0.22 * i;
      const oscillator = context.createOscillator();
      const gain = context.createGain();
      oscillator.frequency.value = frequency;
      gain.gain.setValueAtTime(0, from);
      gain.gain.linearRampToValueAtTime(0.2, from + 0.02);
      gain.gain.linearRampToValueAtTime(0, from + 0.18);
      oscillator.connect(gain).connect(context.destination);
      oscillator.start(from);
      oscillator.stop(from + 0.2);
    });
  }

  repeat(critical: boolean): void {
    if (critical && !this.timer) this.timer = setInterval(() => this.play(true), kRepeat_ms);
    if (critical || !this.timer) return;
    clearInterval(this.timer);
    this.timer = null;
  }
}
