// People on foot, from above: shoulders in a vest across their way, and a helmet.

function drawPeople(context, episode, place, style) {
  for (let i = 0; i < episode.people; i++) {
    const [x, y, heading] = episode.walking.subarray(3 * i, 3 * i + 3);
    intoBody(context, place, x, y, heading);
    const radius = episode.personRadius;
    for (const [along, across, ink] of [
      [0.76 * radius, radius, style.inks.vestEdge],
      [0.6 * radius, 0.84 * radius, style.inks.vest],
      [0.48 * radius, 0.48 * radius, style.inks.vestEdge],
      [0.36 * radius, 0.36 * radius, style.inks.helmet],
    ]) {
      context.fillStyle = ink;
      context.beginPath();
      context.ellipse(0, 0, along, across, 0, 0, TURN);
      context.fill();
    }
  }
  context.setTransform(1, 0, 0, 1, 0, 0);
}
