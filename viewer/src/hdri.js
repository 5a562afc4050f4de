// A light from a Radiance HDR file (.hdr), latitude-longitude, its centre in front of the face.

import { FloatType } from "three";
import { HDRLoader } from "three/addons/loaders/HDRLoader.js";
import { direction } from "./light.js";

const ROWS = 36;
const COLUMNS = 72;

/**
 * The picture in the bytes `buffer` as light.js wants it, at the strength that `unlit relight`
 * gives it (relighting/lights.py).
 */
export function gridOf(buffer) {
  const { width, height, data } = new HDRLoader().setDataType(FloatType).parse(buffer);
  const radiance = new Float32Array(3 * ROWS * COLUMNS);
  const weight = new Float32Array(ROWS * COLUMNS);
  for (let i = 0; i < height; i++) {
    const sine = Math.sin((Math.PI * (i + 0.5)) / height);
    for (let j = 0; j < width; j++) {
      const at = Math.floor((i * ROWS) / height) * COLUMNS + Math.floor((j * COLUMNS) / width);
      weight[at] += sine;
      for (let c = 0; c < 3; c++)
        radiance[3 * at + c] += sine * Math.max(data[4 * (i * width + j) + c], 0);
    }
  }
  for (let k = 0; k < radiance.length; k++) radiance[k] /= Math.max(weight[Math.floor(k / 3)], 1e-9);
  const brightest = brightestCard(radiance);
  if (!(brightest > 0)) throw new Error("it is black");
  return { rows: ROWS, columns: COLUMNS, radiance: radiance.map((value) => value / brightest) };
}

/** What a white card renders as that stands upright and is turned to where it gets most light. */
function brightestCard(radiance) {
  const cards = new Float64Array(COLUMNS);
  for (let i = 0; i < ROWS; i++) {
    const angle =
      (Math.cos((Math.PI * i) / ROWS) - Math.cos((Math.PI * (i + 1)) / ROWS)) *
      ((2 * Math.PI) / COLUMNS);
    for (let j = 0; j < COLUMNS; j++) {
      const { x, z } = direction((j + 0.5) / COLUMNS, (i + 0.5) / ROWS);
      const at = 3 * (i * COLUMNS + j);
      const flux = (angle * (radiance[at] + radiance[at + 1] + radiance[at + 2])) / (3 * Math.PI);
      for (let k = 0; k < COLUMNS; k++) {
        const turn = (2 * Math.PI * k) / COLUMNS;
        cards[k] += flux * Math.max(Math.sin(turn) * x + Math.cos(turn) * z, 0);
      }
    }
  }
  return Math.max(...cards);
}
