// Which part of a picture fills the canvas: the picture is moved and zoomed under the canvas, which stays where it is.

const MAX_ZOOM = 8;
const DIGITS = 1e4; // shares are rounded to these, so that what is shown is what is sent

/**
 * A part of a picture: left, top, width and height as shares of the picture's sides.
 * @typedef {number[]} Crop
 */

const within = (low, value, high) => Math.min(high, Math.max(low, value));

/** The largest part that fills a canvas, from the middle; shapes are width over height. @returns {Crop} */
export function largestCrop(picture, canvas) {
  const [width, height] = [Math.min(1, canvas / picture), Math.min(1, picture / canvas)];
  return [(1 - width) / 2, (1 - height) / 2, width, height];
}

/** A part of that size as near to a place as the picture allows. @returns {Crop} */
const inside = (left, top, width, height) => [within(0, left, 1 - width), within(0, top, 1 - height), width, height];

/**
 * Zooms by a factor around a place of the canvas, in shares of its sides: what is painted there stays there.
 * @param {Crop} crop @param {number} factor @param {number[]} around @param {Crop} largest
 */
export function zoomCrop([left, top, width, height], factor, [x, y], largest) {
  const by = within(1 / MAX_ZOOM, width / factor / largest[2], 1);
  const [across, down] = [largest[2] * by, largest[3] * by];
  return inside(left + x * (width - across), top + y * (height - down), across, down);
}

/** Moves the picture under the canvas, by shares of the canvas's sides. @param {Crop} crop */
export const moveCrop = ([left, top, width, height], across, down) => inside(left - across * width, top - down * height, width, height);

/** The same part for a canvas of another shape: as much of it, around the same middle. @param {Crop} crop */
export function reshapeCrop([left, top, width, height], picture, canvas) {
  const largest = largestCrop(picture, canvas);
  const by = within(1 / MAX_ZOOM, Math.sqrt((width * height) / (largest[2] * largest[3])), 1);
  const [across, down] = [largest[2] * by, largest[3] * by];
  return inside(left + (width - across) / 2, top + (height - down) / 2, across, down);
}

/** The part as it is sent; null if it is what the studio takes by itself. @param {Crop} crop @param {Crop} largest */
export function sentCrop(crop, largest) {
  if (crop.every((share, index) => Math.abs(share - largest[index]) < 1 / DIGITS)) return null;
  const [left, top, width, height] = crop.map((share) => Math.round(share * DIGITS));
  return [Math.min(left, DIGITS - width), Math.min(top, DIGITS - height), width, height].map((share) => share / DIGITS);
}

/** How far it is zoomed in, 1 for the largest part. @param {Crop} crop @param {Crop} largest */
export const zoomOf = (crop, largest) => largest[2] / crop[2];

/** Shows that part of a picture in the whole of its parent; null: as `object-fit: cover` does. @param {HTMLElement} image @param {Crop | null | undefined} crop */
export function showCrop(image, crop) {
  const [left, top, width, height] = crop ?? [0, 0, 1, 1];
  const percent = (share) => (crop ? `${100 * share}%` : "");
  Object.assign(image.style, {
    left: percent(-left / width), top: percent(-top / height), width: percent(1 / width), height: percent(1 / height),
    right: crop ? "auto" : "", bottom: crop ? "auto" : "", maxWidth: crop ? "none" : "", objectFit: crop ? "fill" : "",
  });
}

/** The same for a small picture that covers its own place, where the browser can. @param {Crop | null | undefined} crop */
export const smallCrop = (crop) => (crop ? { objectViewBox: `inset(${[crop[1], 1 - crop[0] - crop[2], 1 - crop[1] - crop[3], crop[0]].map((share) => `${100 * share}%`).join(" ")})` } : {});
