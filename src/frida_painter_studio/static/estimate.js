// How long planning and painting will take, from the pace of the last paintings here.

/**
 * @typedef {{ loading: number, planning: number, opening: number, painting: number, replanning: number, known: boolean }} Pace
 * @typedef {{ strokes: number, effort: number, replans: number }} Size
 */

/** Seconds until a plan is made. @param {Pace} pace @param {Size} size */
export const toPlan = (pace, { strokes, effort }) => pace.loading + pace.planning * strokes * effort;

/**
 * The size of a painting as it is painted: without a camera, nothing is planned again.
 * @param {{ watched: boolean }} house @param {Size} size
 */
export const asPainted = (house, size) => (house.watched ? size : { ...size, replans: 0 });

/**
 * Seconds from the start to the last stroke: at each of the looks, evenly spaced, what is left is planned again.
 * @param {Pace} pace @param {Size} size
 */
export const toPaint = (pace, { strokes, effort, replans }) =>
  pace.opening + pace.painting * strokes + (pace.replanning * effort * strokes * Math.min(replans, strokes - 1)) / 2;

/**
 * The pace, corrected by what one plan of that size really took: the first guesses may be far off on a slow machine.
 * @param {Pace} pace @param {Size} size @param {number} seconds
 */
export function corrected(pace, size, seconds) {
  if (pace.known) return pace;
  const slower = Math.max(1, (seconds - pace.loading) / Math.max(1e-9, pace.planning * size.strokes * size.effort));
  return { ...pace, opening: pace.opening * Math.sqrt(slower), painting: pace.painting * Math.sqrt(slower), replanning: pace.replanning * slower };
}
