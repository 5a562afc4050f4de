// The head turns back and forth by itself, slowly, until somebody touches it.

const DEGREES = 35; // to either side
const SECONDS = 18; // back and forth
const FRAME = { fast: 0, slow: 120 }; // milliseconds between two pictures at least
const TOUCHES = ["pointerdown", "wheel", "keydown"];

export class Turning {
  /**
   * Of the head that `viewer` shows; `told` is called with whether it turns, when that changes.
   * It rests while the canvas is out of sight.
   */
  constructor(viewer, told) {
    this.viewer = viewer;
    this.told = told;
    this.on = this.seen = false;
    this.seconds = 0;
    for (const kind of TOUCHES)
      viewer.canvas.addEventListener(kind, () => this.stop(), { passive: true, capture: true });
    new IntersectionObserver(([entry]) => {
      this.seen = entry.isIntersecting;
      this.#go();
    }).observe(viewer.canvas);
  }

  start() {
    if (this.on) return;
    this.on = true;
    this.seconds = 0;
    this.first = this.viewer.orbit.azimuth();
    this.told(true);
    this.#go();
  }

  stop() {
    if (!this.on) return;
    this.on = false;
    this.told(false);
  }

  #go() {
    if (!this.on || !this.seen || this.waiting) return;
    this.waiting = true;
    let before = performance.now();
    const step = (now) => {
      if (!this.on || !this.seen) return (this.waiting = false);
      requestAnimationFrame(step);
      if (now - before < FRAME[this.viewer.slow ? "slow" : "fast"]) return;
      // A tab that was hidden, or a long pause, is no reason to jump.
      this.seconds += Math.min((now - before) / 1000, 0.2);
      before = now;
      const swing = Math.sin((2 * Math.PI * this.seconds) / SECONDS);
      // From where it was found to the middle of the swing within the first quarter of it.
      const settle = this.first * Math.max(0, 1 - (4 * this.seconds) / SECONDS);
      this.viewer.orbit.face(settle + (DEGREES * swing * Math.PI) / 180);
    };
    requestAnimationFrame(step);
  }
}
