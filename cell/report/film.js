// The film with thin controls and the marks of events; where there are curves over time, both show the same
// moment: a line follows the film, a click on the curves leads to it.
addEventListener("DOMContentLoaded", () => { // once the figures have the size of the window
  const film = document.querySelector(".film video"), figure = film.closest(".film");
  const chart = document.querySelector('[aria-label="states and signals over time"] svg'), layer = figure.querySelector(".read");
  const steer = figure.querySelector(".steer"), button = steer.querySelector("button");
  const slider = steer.querySelector("input"), time = steer.querySelector("output");
  const begin = Number(film.dataset.begin);
  const curves = layer ? JSON.parse(layer.dataset.curves) : [];
  const start = Number(slider.min);
  let line = null, unplayed = true; // opens at the slider's moment, plays from the start

  film.addEventListener("error", () => { figure.querySelector(".unplayed").hidden = false; });
  film.controls = false;
  steer.hidden = false;
  button.addEventListener("click", () => {
    if (!film.paused) return film.pause();
    if (unplayed || film.ended) film.currentTime = start;
    unplayed = false;
    film.play();
  });
  film.addEventListener("click", () => button.click());
  const lead = (place) => {
    unplayed = false;
    film.currentTime = Math.max(start, place);
  };
  slider.addEventListener("input", () => lead(Number(slider.value)));
  steer.querySelector("label input")?.addEventListener("change", ({ target }) => {
    layer.style.display = target.checked ? "" : "none";
  });

  const draw = (t) => { // the curve read last, for as long as images come
    const at = curves.findLast(([stamp]) => stamp <= t + 0.001);
    layer?.firstElementChild.setAttribute("points", at && t - at[0] < 0.3 ? at[1].join(" ") : "");
  };
  const onChart = (t) => {
    if (!line) return;
    const [first, last, left, right] =
      [chart.dataset.first, chart.dataset.last, chart.dataset.left, chart.dataset.right].map(Number);
    const width = chart.viewBox.baseVal.width;
    const place = width * (left + ((right - left) * (t - first)) / (last - first));
    const x = chart.zoomed?.applyX(place) ?? place;
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
    line.style.visibility = x < width * left || x > width * right ? "hidden" : "visible";
  };
  const show = () => {
    const t = begin + film.currentTime;
    draw(t);
    onChart(t);
    slider.value = film.currentTime;
    button.textContent = film.paused ? "▶" : "❚❚";
    time.textContent = `${t.toFixed(2).replace("-", "−")} s`;
  };
  const follow = () => {
    show();
    if (!film.paused) requestAnimationFrame(follow);
  };
  for (const event of ["play", "pause", "seeked", "timeupdate", "loadedmetadata"]) film.addEventListener(event, follow);

  if (chart) {
    line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    line.setAttribute("class", "now");
    line.setAttribute("y1", 0);
    line.setAttribute("y2", chart.viewBox.baseVal.height);
    chart.append(line);
    chart.addEventListener("zoomed", show);
    chart.addEventListener("click", (event) => {
      const frame = chart.getBoundingClientRect(), width = chart.viewBox.baseVal.width;
      const [first, last, left, right] =
        [chart.dataset.first, chart.dataset.last, chart.dataset.left, chart.dataset.right].map(Number);
      const place = (width * (event.clientX - frame.left)) / frame.width;
      const share = ((chart.zoomed?.invertX(place) ?? place) / width - left) / (right - left);
      lead(first + share * (last - first) - begin);
    });
  }
  film.currentTime = Number(slider.value);
  show();
});
