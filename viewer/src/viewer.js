// Scene, light and camera put together. Drawn on demand.

import { Color, LinearSRGBColorSpace, Scene, Vector3, WebGLRenderer } from "three";
import { Balls, LIGHTS } from "./ball.js";
import { Orbit } from "./camera.js";
import { headOf } from "./head.js";
import { irradiance, merged, turn, turnedLights } from "./light.js";

const BACKGROUND = new Color().setRGB(0.1, 0.1, 0.1); // encoded
const SLOW = 40; // milliseconds a frame: software rendering
const REST = { fast: 150, slow: 600 }; // milliseconds after which what moved is drawn finely

export class Viewer {
  /** Show `scene` (data.js) with its textures `images` on `canvas`; throws without WebGL 2. */
  constructor(canvas, scene, images) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: false });
    this.renderer.outputColorSpace = LinearSRGBColorSpace; // the shader encodes
    this.renderer.setClearColor(BACKGROUND);
    this.balls = new Balls();
    this.head = headOf(scene, images, this.balls);
    this.world = new Scene().add(this.head);
    this.cells = scene.arrays.visibility;
    this.uniforms = this.head.material.uniforms;
    this.orbit = new Orbit(scene.camera, canvas, new Vector3(...scene.middle), () => this.draw());
    this.angles = [0, 0];
    this.waiting = this.turned = false;
    this.slow = null;
    /** Settled once the first picture is there, and `slow` is known. */
    this.drawn = new Promise((done) => (this.first = done));
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** Set a number of the shader: a switch, or the exposure. */
  set(name, value) {
    this.uniforms[name].value = value;
    this.draw();
  }

  /** Take the light `grid` (light.js) in place of the one before. */
  illuminate(grid) {
    this.lights = merged(grid, LIGHTS);
    this.turnLight(...this.angles);
  }

  /** Turn the light by radians to the right and up. */
  turnLight(yaw, pitch) {
    this.angles = [yaw, pitch];
    this.turned = true;
    this.draw();
  }

  /** Draw when the screen is next refreshed, coarsely if need be, and finely at rest. */
  draw() {
    clearTimeout(this.rest);
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      if (this.turned) this.#light();
      this.slow ??= this.#isSlow();
      this.#render(this.slow ? 0.5 : devicePixelRatio);
      this.first();
      // Two pixels for one smooth the edges.
      const finely = () => this.#render(this.slow ? 1 : 2);
      this.rest = setTimeout(finely, this.slow ? REST.slow : REST.fast);
    });
  }

  /** Draw with `density` pixels per CSS pixel. */
  #render(density) {
    const side = Math.round(this.canvas.clientWidth * density);
    if (this.canvas.width !== side) this.renderer.setSize(side, side, false);
    this.uniforms.eye.value.copy(this.orbit.camera.position);
    this.balls.draw(this.renderer, this.orbit.camera, this.orbit.middle);
    this.renderer.render(this.world, this.orbit.camera);
  }

  #isSlow() {
    const context = this.renderer.getContext();
    const time = () => {
      const before = performance.now();
      this.#render(1);
      // Reading waits until the picture is finished.
      context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, new Uint8Array(4));
      return performance.now() - before;
    };
    time(); // compiles
    return time() > SLOW;
  }

  #light() {
    this.turned = false;
    const lights = turnedLights(this.lights, turn(...this.angles));
    this.balls.light(lights);
    const { normal, open, direct } = this.head.geometry.attributes;
    irradiance(lights, this.cells, normal.array, open.array, direct.array);
    open.needsUpdate = direct.needsUpdate = true;
  }
}
