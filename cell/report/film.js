// The film and the curves show the same moment: a line follows the film, a click on the curves leads to it.
for (const film of document.querySelectorAll("video[data-begin]")) {
  const chart = film.closest("section").querySelector("svg[data-first]");
  const time = film.parentElement.querySelector("output");
  film.addEventListener("error", () => {
    film.nextElementSibling.hidden = false;
  });
  if (!chart) continue;
  const [first, last, left, right, begin] =
    [chart.dataset.first, chart.dataset.last, chart.dataset.left, chart.dataset.right, film.dataset.begin].map(Number);
  const box = chart.viewBox.baseVal;
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  line.setAttribute("class", "now");
  line.setAttribute("y1", 0);
  line.setAttribute("y2", box.height);
  chart.append(line);
  const show = () => {
    const t = begin + film.currentTime;
    const x = box.width * (left + ((right - left) * (t - first)) / (last - first));
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
    line.style.visibility = t < first || t > last ? "hidden" : "visible";
    time.textContent = `t = ${t.toFixed(2).replace("-", "−")} s`;
  };
  const follow = () => {
    show();
    if (!film.paused) requestAnimationFrame(follow);
  };
  for (const event of ["play", "seeked", "timeupdate", "loadedmetadata"]) film.addEventListener(event, follow);
  chart.addEventListener("click", (event) => {
    const frame = chart.getBoundingClientRect();
    const share = ((event.clientX - frame.left) / frame.width - left) / (right - left);
    film.currentTime = Math.max(0, first + share * (last - first) - begin);
  });
  show();
}
