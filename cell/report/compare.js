// Films of several runs in step: one clock, the time since each lift.
const films = [...document.querySelectorAll("video[data-begin]")];
const steer = document.querySelector(".steer");
const button = steer.querySelector("button"), slider = steer.querySelector("input"), said = steer.querySelector("output");
const place = (film, t) => Math.max(0, t - Number(film.dataset.begin));
let started = null; // what the clock showed at t = 0, null while it stands
let unplayed = true; // opens at the slider's moment, plays from the lift on

function show(t, jump) {
  said.textContent = `${t.toFixed(2)} s`;
  for (const film of films) {
    if (jump || film.paused || Math.abs(film.currentTime - place(film, t)) > 0.15) film.currentTime = place(film, t);
  }
}

function stop() {
  started = null;
  button.textContent = "▶";
  films.forEach((film) => film.pause());
}

function run(now) {
  if (started === null) return;
  const t = (now - started) / 1000;
  if (t > Number(slider.max)) return stop();
  slider.value = t;
  show(t, false);
  requestAnimationFrame(run);
}

button.addEventListener("click", () => {
  if (started !== null) return stop();
  const t = unplayed || slider.value > slider.max - 0.1 ? 0 : Number(slider.value);
  show(t, true);
  button.textContent = "❚❚";
  unplayed = false;
  films.forEach((film) => film.play());
  requestAnimationFrame((now) => { started = now - 1000 * t; run(now); });
});
slider.addEventListener("input", () => { stop(); unplayed = false; show(Number(slider.value), true); });
for (const film of films) {
  film.addEventListener("loadedmetadata", () => {
    slider.max = Math.max(Number(slider.max), film.duration + Number(film.dataset.begin));
    show(Number(slider.value), true);
  });
}
