// The viewer of report.html: gives the page's controls (report/web/viewer.html) their effect.

import { sceneOf } from "./data.js";
import { gridOf } from "./hdri.js";
import { SWITCHES } from "./head.js";
import { Turning } from "./turning.js";
import { Viewer } from "./viewer.js";

const RADIANS = Math.PI / 180;
const STEP = 10; // degrees, of a key
const IMAGES = {
  diffuseAlbedo: "atlas-diffuse-albedo",
  material: "atlas-material",
  specularNormal: "atlas-specular-normal",
  diffuseNormal: "atlas-diffuse-normal",
};

const element = (id) => document.getElementById(id);
const say = (text) => (element("view-state").textContent = text);

async function decoded(id) {
  await element(id).decode();
  return element(id);
}

async function start() {
  const scene = await sceneOf(document);
  const names = Object.keys(IMAGES);
  const pictures = await Promise.all(Object.values(IMAGES).map(decoded));
  const images = Object.fromEntries(names.map((name, i) => [name, pictures[i]]));
  const canvas = element("view");
  const viewer = new Viewer(canvas, scene, images);

  const [light, file, yaw, pitch, exposure] = [
    ...["light", "light-file", "light-yaw", "light-pitch", "exposure"],
  ].map(element);

  const turned = () => viewer.turnLight(yaw.value * RADIANS, pitch.value * RADIANS);
  const exposed = () => viewer.set("exposure", 2 ** exposure.value);
  const describe = () => {
    const [right, up] = viewer.orbit.angles();
    say(
      `Camera ${right} degrees to the right, ${up} up. ` +
        `Light turned ${yaw.value} to the right, ${pitch.value} up.`,
    );
  };

  light.addEventListener("change", () => {
    viewer.illuminate(scene.lights[light.value]);
    file.value = "";
  });
  file.addEventListener("change", async () => {
    if (!file.files.length) return;
    try {
      viewer.illuminate(gridOf(await file.files[0].arrayBuffer()));
      say(`Lit by ${file.files[0].name}.`);
    } catch (error) {
      say(`${file.files[0].name} is no Radiance HDR picture (${error.message ?? error}).`);
    }
  });
  for (const slider of [yaw, pitch]) {
    slider.addEventListener("input", turned);
    slider.addEventListener("change", describe);
  }
  exposure.addEventListener("input", exposed);
  for (const name of SWITCHES) {
    const box = element(name);
    box.addEventListener("change", () => viewer.set(name, Number(box.checked)));
    viewer.set(name, Number(box.checked)); // browsers keep a form's state on reloading
  }

  const button = element("view-turn");
  const turning = new Turning(viewer, (on) => {
    button.setAttribute("aria-pressed", on);
    if (!on) describe();
  });
  button.addEventListener("click", () => (turning.on ? turning.stop() : turning.start()));

  const reset = () => {
    turning.stop();
    viewer.orbit.reset();
    if (light.value !== "photo" || file.files.length) {
      light.value = "photo";
      light.dispatchEvent(new Event("change"));
    }
    for (const input of [yaw, pitch, exposure]) input.value = 0;
    turned();
    exposed();
  };
  const slide = (slider, by) => {
    // Round and round, but not over the poles.
    const value = Number(slider.value) + by;
    slider.value = slider === yaw ? ((value + 540) % 360) - 180 : value;
    turned();
  };
  const keys = {
    ArrowLeft: () => viewer.orbit.move(-STEP * RADIANS, 0),
    ArrowRight: () => viewer.orbit.move(STEP * RADIANS, 0),
    ArrowUp: () => viewer.orbit.move(0, STEP * RADIANS),
    ArrowDown: () => viewer.orbit.move(0, -STEP * RADIANS),
    a: () => slide(yaw, -STEP),
    d: () => slide(yaw, STEP),
    w: () => slide(pitch, STEP),
    s: () => slide(pitch, -STEP),
    "+": () => viewer.orbit.move(0, 0, 1.1),
    "-": () => viewer.orbit.move(0, 0, 1 / 1.1),
    0: reset,
  };
  canvas.addEventListener("keydown", (event) => {
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    act();
    describe();
  });
  canvas.addEventListener("pointerup", describe);
  element("view-reset").addEventListener("click", () => {
    reset();
    describe();
  });

  exposed();
  viewer.angles = [yaw.value * RADIANS, pitch.value * RADIANS];
  viewer.illuminate(scene.lights[light.value]);
  await viewer.drawn;
  element("viewer").dataset.ready = "";
  // Not for who asked for less motion, and not where every picture costs the machine dear.
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (still || viewer.slow) describe();
  else turning.start();
}

function failed(error) {
  console.info(error);
  element("viewer").dataset.failed = "";
  say("The head in three dimensions needs WebGL 2, which this browser does not give: pictures instead.");
}

// Only once it is looked at: the rest of the page should not wait.
new IntersectionObserver((entries, observer) => {
  if (!entries.some((entry) => entry.isIntersecting)) return;
  observer.disconnect();
  start().catch(failed);
}).observe(element("view"));
