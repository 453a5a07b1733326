// What a page asks of the server: menus, sliders, buttons; its answers are shown as a sentence.

const SPEED_STEPS = [0.25, 0.5, 1, 2, 4, 8, 16, 32, null]; // null: as fast as the machine can
const SAID_FOR = 6000; // [ms]

const LIVE_KEYS = [
  { keys: [" ", "k"], shown: "Space", says: "play or pause", act: (app) => play(app) },
  { keys: ["ArrowRight"], shown: "→", says: "pause, then one step", act: () => send({ do: "step" }) },
  { keys: ["ArrowUp"], shown: "↑", says: "faster", act: (app) => faster(app, 1) },
  { keys: ["ArrowDown"], shown: "↓", says: "slower", act: (app) => faster(app, -1) },
];

let sending = Promise.resolve(), silence = 0;

// Send a command behind all before it; resolves to whether it was carried out.
function send(command) {
  sending = sending.then(async () => {
    try {
      const body = JSON.stringify(command);
      const answer = await fetch("commands", { method: "POST", headers: { "Content-Type": "application/json" }, body });
      if (!answer.ok) say((await answer.json()).error);
      return answer.ok;
    } catch {
      say("The simulation does not answer.");
      return false;
    }
  });
  return sending;
}

function say(sentence) {
  const place = document.querySelector("#said");
  place.textContent = sentence;
  place.classList.add("shown");
  clearTimeout(silence);
  silence = setTimeout(() => place.classList.remove("shown"), SAID_FOR);
}

function play(app) {
  send({ do: "play", playing: !app.pace.playing });
}

function faster(app, by) {
  const now = SPEED_STEPS.indexOf(app.pace.speed);
  send({ do: "speed", speed: SPEED_STEPS[Math.min(Math.max(now + by, 0), SPEED_STEPS.length - 1)] });
}

// Ask for another world; where it is refused the menus show again what is.
async function make(app, asked) {
  if (!(await send({ do: "make", ...asked }))) showWorld(app);
}

function buildSteering(app) {
  const { about } = app;
  const said = element("p");
  said.id = "said";
  said.setAttribute("role", "status");
  document.querySelector("#stage").append(said);
  const at = (id) => document.querySelector(`#${id}`);
  for (const [name, says] of Object.entries(about.policies)) {
    at("policy").add(new Option(name, name));
    at("policy").lastChild.title = says;
  }
  for (const name of about.floors) at("floor").add(new Option(name, name));
  at("robots").max = about.most;
  at("speed").max = SPEED_STEPS.length - 1;
  at("policy").addEventListener("change", () => make(app, { policy: at("policy").value }));
  at("floor").addEventListener("change", () => make(app, { floor: at("floor").value }));
  at("robots").addEventListener("input", () => (at("robots-said").textContent = at("robots").value));
  at("robots").addEventListener("change", () => make(app, { robots: Number(at("robots").value) }));
  at("speed").addEventListener("input", () => send({ do: "speed", speed: SPEED_STEPS[at("speed").value] }));
  at("seed").addEventListener("input", () => at("seed").setCustomValidity(""));
  at("anew").addEventListener("click", () => anew(app));
  buildButtons(app, { play: () => play(app), step: () => send({ do: "step" }) });
  buildKeys(app, [...LIVE_KEYS, ...KEYS]);
}

function anew(app) {
  const seed = document.querySelector("#seed");
  const right = /^\d{1,16}$/.test(seed.value) && Number.isSafeInteger(Number(seed.value));
  seed.setCustomValidity(right ? "" : "a seed is a whole number");
  if (seed.reportValidity()) make(app, { seed: Number(seed.value) });
}

// What the menus say of the world that is.
function showWorld(app) {
  const { policy, floor, robots, seed } = app.episode;
  for (const [id, value] of Object.entries({ policy, floor, robots, seed })) document.querySelector(`#${id}`).value = value;
  document.querySelector("#robots-said").textContent = robots;
}

// How time goes, and whether another world is being made.
function showPace(app) {
  const { playing, speed, reached, making } = app.pace;
  const button = document.querySelector("#play"), slider = document.querySelector("#speed");
  button.classList.toggle("playing", playing);
  button.setAttribute("aria-label", playing ? "pause" : "go on");
  if (document.activeElement !== slider || !slider.matches(":active")) slider.value = SPEED_STEPS.indexOf(speed);
  const told = element("b", "", speed === null ? "fastest" : `${speed}×`);
  const rest = playing ? (reached ? `, reached ${reached < 9.95 ? reached.toFixed(1) : Math.round(reached)}×` : "") : ", paused";
  document.querySelector("#pace").replaceChildren(told, element("span", "", rest));
  showMaking(making);
}

function showMaking(making) {
  const place = document.querySelector("#loading");
  place.hidden = !making;
  if (making) place.textContent = making;
  for (const control of document.querySelectorAll("#world select, #world input, #world button")) control.disabled = Boolean(making);
}
