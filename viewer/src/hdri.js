// A light from a Radiance HDR file (.hdr), latitude-longitude, its centre in front of the face.

import { FloatType } from "three";
import { HDRLoader } from "three/addons/loaders/HDRLoader.js";

const ROWS = 36;
const COLUMNS = 72;

/** The picture in the bytes `buffer` as light.js wants it, with a mean radiance of 1. */
export function gridOf(buffer) {
  const { width, height, data } = new HDRLoader().setDataType(FloatType).parse(buffer);
  const radiance = new Float32Array(3 * ROWS * COLUMNS);
  const weight = new Float32Array(ROWS * COLUMNS);
  let total = 0;
  let area = 0;
  for (let i = 0; i < height; i++) {
    const sine = Math.sin((Math.PI * (i + 0.5)) / height);
    for (let j = 0; j < width; j++) {
      const at = Math.floor((i * ROWS) / height) * COLUMNS + Math.floor((j * COLUMNS) / width);
      weight[at] += sine;
      area += sine;
      for (let c = 0; c < 3; c++) {
        const value = sine * data[4 * (i * width + j) + c];
        radiance[3 * at + c] += value;
        total += value / 3;
      }
    }
  }
  for (let k = 0; k < radiance.length; k++)
    radiance[k] *= area / total / Math.max(weight[Math.floor(k / 3)], 1e-9);
  return { rows: ROWS, columns: COLUMNS, radiance };
}
