// The cursor of frequency responses: one line through every plot of a grid, with what each curve is there.
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const show = (value) => (value >= 1000 || value < 0.001 ? value.toExponential(2).replace("e", "·10^") : String(Number(value.toPrecision(4))));

  function place(data, cell, index) {
    const [low, high] = [data.hz[0], data.hz[data.hz.length - 1]].map((hz) => (data.log ? Math.log(hz) : hz));
    const hz = data.log ? Math.log(data.hz[index]) : data.hz[index];
    return cell.axis[0] + ((cell.axis[1] - cell.axis[0]) * (hz - low)) / (high - low);
  }

  function nearest(data, cell, x) {
    let low = 0, high = data.hz.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (place(data, cell, middle) < x) low = middle; else high = middle;
    }
    return x - place(data, cell, low) < place(data, cell, high) - x ? low : high;
  }

  function add(group, name, attributes, text) {
    const item = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) item.setAttribute(key, value);
    if (text !== undefined) item.textContent = text;
    group.append(item);
  }

  function draw(data, group, index) {
    group.replaceChildren();
    const [title, tall, gap, phase] = data.heights;
    for (const cell of data.cells) {
      const x = place(data, cell, index), top = cell.box[1] + title;
      add(group, "line", { x1: x, x2: x, y1: top, y2: top + tall + gap + phase, stroke: "currentColor", opacity: 0.6 });
      const size = cell.size[index], angle = cell.phase[index];
      if (size === null) continue;
      const share = Math.log(Math.max(size, cell.range[0]) / cell.range[0]) / Math.log(cell.range[1] / cell.range[0]);
      add(group, "circle", { cx: x, cy: top + tall * (1 - share), r: 3.5, fill: cell.color });
      const words = `${show(data.hz[index])} Hz: ${show(size)}${angle === null ? "" : `, ${Math.round(angle)}°`}`;
      add(group, "text", { x: cell.axis[1], y: top - 8, "font-size": 11.5, "font-weight": 600, "text-anchor": "end", fill: cell.color }, words.replaceAll("-", "−"));
    }
    group.setAttribute("visibility", "visible");
  }

  for (const source of document.querySelectorAll("script.response-data")) {
    const data = JSON.parse(source.textContent), svg = document.getElementById(source.dataset.for), group = svg.querySelector(".cursor");
    svg.addEventListener("pointermove", (event) => {
      const spot = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      // the plots of a column share their axis
      const under = data.cells.find(({ box }) => spot.x >= box[0] && spot.x <= box[0] + box[2]);
      if (under) draw(data, group, nearest(data, under, spot.x));
    });
    svg.addEventListener("pointerleave", () => group.setAttribute("visibility", "hidden"));
  }
})();
