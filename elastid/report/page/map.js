// The map: two cuts coloured by a quantity, a posture by click, slider or table, its response with band.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("map-data").textContent);
  const numbers = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const [x, y, r, z] = data.places.map(numbers);
  const quantities = data.quantities.map((q) => ({ ...q, columns: q.columns.map(numbers) }));
  const [angles, share, lines, curve, std] = ["angles", "share", "lines", "curve", "std"].map((key) => numbers(data[key]));
  const by = (id) => document.getElementById(id);
  const [choice, width, slider, name, body] = [by("quantity"), by("width"), by("posture"), by("name"), by("numbers").tBodies[0]];
  const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const MARGIN = 42;
  let chosen = data.softest[0];

  const short = (value) => (Number.isFinite(value) ? Number(value.toPrecision(4)).toString() : "no limit");
  const color = (part) => {
    const at = Math.min(Math.max(part, 0), 1) * (VIRIDIS.length - 1);
    const i = Math.min(Math.floor(at), VIRIDIS.length - 2);
    return `rgb(${VIRIDIS[i].map((a, k) => Math.round(a + (at - i) * (VIRIDIS[i + 1][k] - a))).join(",")})`;
  };
  const ink = () => getComputedStyle(document.body).color;
  const accent = () => getComputedStyle(document.documentElement).getPropertyValue("--bad").trim();

  // What is coloured: the quantity, or the width of its interval in percent.
  const shown = () => {
    const q = quantities[choice.selectedIndex];
    const [value, low, high] = q.columns;
    const values = width.checked ? value.map((v, i) => (100 * (high[i] - low[i])) / v / 2) : value;
    const finite = [...values].filter((v) => Number.isFinite(v)).sort((a, b) => a - b);
    const [first, last] = [finite[0] ?? 0, finite[finite.length - 1] ?? 1];
    const log = first > 0 && last > 10 * first;
    const scale = (v) => (log ? Math.log(v / first) / Math.log(last / first) : (v - first) / (last - first || 1));
    return { values, first, last, scale, text: width.checked ? `${q.text}: half the 95 % interval in %` : `${q.text} in ${q.unit}` };
  };

  // Places of points in pixels, one scale for both directions.
  const projection = (canvas, a, b) => {
    const ends = (v) => [Math.min(...v), Math.max(...v)];
    const [[a0, a1], [b0, b1]] = [ends(a), ends(b)];
    const scale = Math.min((canvas.width - 1.4 * MARGIN) / (a1 - a0 || 1), (canvas.height - 1.4 * MARGIN) / (b1 - b0 || 1));
    return { px: (v) => MARGIN + scale * (v - a0), py: (v) => canvas.height - MARGIN - scale * (v - b0), a, b, a0, a1, b0, b1 };
  };

  const view = (canvas, a, b, labels, own) => {
    const at = projection(canvas, a, b);
    const g = canvas.getContext("2d");
    g.clearRect(0, 0, canvas.width, canvas.height);
    g.font = "11px system-ui, sans-serif";
    g.fillStyle = ink();
    g.fillText(`${labels[0]}: ${short(at.a0)} to ${short(at.a1)} m`, MARGIN, canvas.height - 12);
    g.save();
    g.rotate(-Math.PI / 2);
    g.fillText(`${labels[1]}: ${short(at.b0)} to ${short(at.b1)} m`, MARGIN - canvas.height, 16);
    g.restore();
    if (data.is_path) {
      g.strokeStyle = "#9aa1a9";
      g.beginPath();
      a.forEach((v, i) => g.lineTo(at.px(v), at.py(b[i])));
      g.stroke();
    }
    own.values.forEach((v, i) => {
      g.fillStyle = Number.isFinite(v) ? color(own.scale(v)) : "#9aa1a9";
      g.fillRect(at.px(a[i]) - 2, at.py(b[i]) - 2, 4, 4);
    });
    g.strokeStyle = accent();
    g.lineWidth = 2;
    g.beginPath();
    g.arc(at.px(a[chosen]), at.py(b[chosen]), 7, 0, 2 * Math.PI);
    g.stroke();
    return at;
  };

  const bar = (own) => {
    const canvas = by("scale");
    const g = canvas.getContext("2d");
    g.clearRect(0, 0, canvas.width, canvas.height);
    for (let i = 0; i < canvas.width; i += 1) {
      g.fillStyle = color(i / canvas.width);
      g.fillRect(i, 0, 1, 12);
    }
    g.fillStyle = ink();
    g.font = "11px system-ui, sans-serif";
    g.fillText(short(own.first), 0, 28);
    g.textAlign = "center";
    g.fillText(own.text, canvas.width / 2, 28);
    g.textAlign = "right";
    g.fillText(short(own.last), canvas.width, 28);
    g.textAlign = "left";
  };

  const response = () => {
    const canvas = by("response");
    const g = canvas.getContext("2d");
    const n = lines.length;
    const own = curve.subarray(chosen * n, (chosen + 1) * n);
    const spread = std.subarray(chosen * n, (chosen + 1) * n);
    const [low, high] = [-1, 1].map((sign) => own.map((v, i) => v * Math.exp((sign * 1.96 * spread[i]) / v)));
    const [top, bottom] = [Math.log10(Math.max(...high)) + 0.1, Math.log10(Math.min(...low)) - 0.1];
    const px = (f) => MARGIN + ((canvas.width - 1.4 * MARGIN) * Math.log(f / lines[0])) / Math.log(lines[n - 1] / lines[0]);
    const py = (v) => canvas.height - MARGIN - ((canvas.height - 1.4 * MARGIN) * (Math.log10(v) - bottom)) / (top - bottom);
    g.clearRect(0, 0, canvas.width, canvas.height);
    g.font = "11px system-ui, sans-serif";
    g.strokeStyle = "#9aa1a955";
    g.fillStyle = ink();
    for (let k = Math.ceil(bottom); k <= top; k += 1) {
      g.fillText((10 ** k).toPrecision(1), 4, py(10 ** k) + 4);
      g.strokeRect(MARGIN, py(10 ** k), canvas.width - 1.4 * MARGIN, 0);
    }
    for (const f of [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].filter((v) => v > lines[0] && v < lines[n - 1])) {
      g.fillText(String(f), px(f) - 6, canvas.height - MARGIN + 16);
      g.strokeRect(px(f), 0.4 * MARGIN, 0, canvas.height - 1.4 * MARGIN);
    }
    g.fillText("frequency in Hz", canvas.width / 2 - 40, canvas.height - 8);
    g.fillStyle = "#d55e0055";
    g.beginPath();
    low.forEach((v, i) => g.lineTo(px(lines[i]), py(v)));
    for (let i = n - 1; i >= 0; i -= 1) g.lineTo(px(lines[i]), py(high[i]));
    g.fill();
    g.strokeStyle = "#d55e00";
    g.lineWidth = 1.6;
    g.beginPath();
    own.forEach((v, i) => g.lineTo(px(lines[i]), py(v)));
    g.stroke();
  };

  const table = () => {
    body.replaceChildren(
      ...quantities.map((q) => {
        const row = document.createElement("tr");
        const [value, low, high] = q.columns.map((column) => column[chosen]);
        const ends = Number.isFinite(low) && Number.isFinite(high) ? `${short(low)} to ${short(high)}` : "unknown";
        for (const text of [q.text, `${short(value)} ${Number.isFinite(value) ? q.unit : ""}`, ends]) {
          row.appendChild(document.createElement("td")).textContent = text;
        }
        row.cells[0].className = "text";
        return row;
      }),
    );
    const own = angles.subarray(chosen * data.joints.length, (chosen + 1) * data.joints.length);
    const springs = share.subarray(chosen * data.springs.length, (chosen + 1) * data.springs.length);
    const most = springs.indexOf(Math.max(...springs));
    const limit = most < 0 ? "" : `; ${data.springs[most]} gives ${Math.round(100 * springs[most])} %`;
    name.textContent = `${data.asked[chosen]}: ${data.joints.map((joint, i) => `${joint} = ${short(own[i])}${data.units[i]}`).join(", ")}${limit}`;
  };

  let places = [];
  const draw = () => {
    const own = shown();
    places = [view(by("above"), x, y, ["x", "y"], own), view(by("side"), r, z, ["distance from z", "z"], own)];
    bar(own);
    response();
    table();
    slider.value = String(chosen);
  };
  const choose = (i) => {
    chosen = i;
    draw();
  };

  quantities.forEach((q) => choice.add(new Option(q.text, q.name)));
  slider.max = String(data.count - 1);
  choice.addEventListener("change", draw);
  width.addEventListener("change", draw);
  slider.addEventListener("input", () => choose(Number(slider.value)));
  ["above", "side"].forEach((id, k) =>
    by(id).addEventListener("click", (event) => {
      const box = event.target.getBoundingClientRect();
      const [u, v] = [((event.clientX - box.left) * event.target.width) / box.width, ((event.clientY - box.top) * event.target.height) / box.height];
      const away = Array.from(places[k].a, (value, i) => Math.hypot(places[k].px(value) - u, places[k].py(places[k].b[i]) - v));
      choose(away.indexOf(Math.min(...away)));
    }),
  );
  document.querySelectorAll("button.open").forEach((button) => button.addEventListener("click", () => choose(data.softest[Number(button.dataset.rank)])));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  draw();
})();
