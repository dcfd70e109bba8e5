// What a look at the canvas has changed, in a sentence or two.

const WHY = {
  region: "It replanned the rest so that no stroke touches the protected part.",
  only: "It replanned the rest so that all strokes lie in the marked part.",
  freed: "The protection is removed, and it replanned the rest.",
  goal: "The goal has changed, and it replanned the rest.",
  asked: "You asked for a look, and it replanned the rest.",
  "": "It replanned the rest.",
};

/**
 * What came of a look. `why` is what a person had asked for before it ("" for a look of its own); the loss of `planned`
 * tells by which share of what was missing the new rest comes nearer to the goal than the old one; null where there is no
 * new one (yet). Without a goal (`together`) there is nothing to come nearer to.
 * @param {Pick<Look, "why" | "planned">} look @param {boolean} together
 */
export function outcome({ why, planned }, together = false) {
  if (!planned?.look || together) return "";
  const gain = planned.loss_before > 0 ? 1 - planned.loss_after / planned.loss_before : 0;
  const share = Math.round(100 * Math.abs(gain));
  const goal = why === "goal" ? "the new goal" : "the goal";
  const compared = share === 0 ? `The new strokes come as close to ${goal} as the old ones.`
    : gain > 0 ? `The new strokes come ${share} % closer to ${goal} than the old ones.`
      : `The new strokes end ${share} % farther from ${goal} than the old ones${why === "region" || why === "only" ? ", because a part is left out" : ""}.`;
  return `${WHY[why] ?? WHY[""]} ${compared}`;
}
