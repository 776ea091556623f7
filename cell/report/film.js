// The film and the curves show the same moment: a line follows the film, a click on the curves leads to it.
addEventListener("DOMContentLoaded", () => { // once the figures have the size of the window
  for (const film of document.querySelectorAll("video[data-begin]")) {
    const chart = film.closest("section").querySelector("svg[data-first]");
    const time = film.parentElement.querySelector("output"), layer = film.parentElement.querySelector(".read");
    film.addEventListener("error", () => {
      film.parentElement.querySelector("p").hidden = false;
    });
    const curves = layer ? JSON.parse(layer.dataset.curves) : [];
    const draw = (t) => { // the curve read last, for as long as images come
      const at = curves.findLast(([stamp]) => stamp <= t + 0.001);
      layer?.firstElementChild.setAttribute("points", at && t - at[0] < 0.3 ? at[1].join(" ") : "");
    };
    film.parentElement.querySelector("input")?.addEventListener("change", ({ target }) => {
      layer.style.display = target.checked ? "" : "none";
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
      draw(t);
      const place = box.width * (left + ((right - left) * (t - first)) / (last - first));
      const x = chart.zoomed?.applyX(place) ?? place;
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
      line.style.visibility = x < box.width * left || x > box.width * right ? "hidden" : "visible";
      time.textContent = `t = ${t.toFixed(2).replace("-", "−")} s`;
    };
    const follow = () => {
      show();
      if (!film.paused) requestAnimationFrame(follow);
    };
    for (const event of ["play", "seeked", "timeupdate", "loadedmetadata"]) film.addEventListener(event, follow);
    chart.addEventListener("zoomed", show);
    chart.addEventListener("click", (event) => {
      const frame = chart.getBoundingClientRect();
      const place = (box.width * (event.clientX - frame.left)) / frame.width;
      const share = ((chart.zoomed?.invertX(place) ?? place) / box.width - left) / (right - left);
      film.currentTime = Math.max(0, first + share * (last - first) - begin);
    });
    show();
  }
});
