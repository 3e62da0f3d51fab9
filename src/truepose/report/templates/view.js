"use strict";
for (const root of document.querySelectorAll(".view")) {
  const scene = JSON.parse(root.querySelector("script").textContent);
  const canvas = root.querySelector("canvas"), context = canvas.getContext("2d"), told = root.querySelector("output");
  const inputs = Object.fromEntries([...root.querySelectorAll("input")].map((input) => [input.value || input.name, input]));
  const slider = root.querySelector("input[type=range]"), arm = scene.arm || [];
  const all = scene.p.concat(arm);
  const low = [0, 1, 2].map((k) => Math.min(...all.map((p) => p[k])));
  const high = [0, 1, 2].map((k) => Math.max(...all.map((p) => p[k])));
  const middle = low.map((v, k) => (v + high[k]) / 2), size = Math.hypot(...low.map((v, k) => high[k] - v)) || 1;
  let turn = 0.5, tilt = 0.4, zoom = 1, drag = null, near = -1, places = [];

  function project(p) {
    const [x, y, z] = p.map((v, k) => v - middle[k]);
    const a = x * Math.cos(turn) - y * Math.sin(turn), b = x * Math.sin(turn) + y * Math.cos(turn);
    const scale = (zoom * Math.min(canvas.clientWidth, 1.5 * canvas.clientHeight)) / size;
    return [
      canvas.clientWidth / 2 + scale * a,
      canvas.clientHeight / 2 - scale * (z * Math.cos(tilt) + b * Math.sin(tilt)),
    ];
  }
  function line(points, colour, width) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    points.forEach((p, k) => context[k ? "lineTo" : "moveTo"](...p));
    context.stroke();
  }
  function dot(at, radius, colour) {
    context.fillStyle = colour;
    context.beginPath();
    context.arc(...at, radius, 0, 7);
    context.fill();
  }
  function arrow(from, to, colour) {
    line([from, to], colour, 1.4);
    const angle = Math.atan2(to[1] - from[1], to[0] - from[0]), long = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const head = Math.min(7, 0.4 * long);
    const side = (s) => [to[0] - head * Math.cos(angle + s), to[1] - head * Math.sin(angle + s)];
    line([side(0.45), to, side(-0.45)], colour, 1.4);
  }
  function number(value) {
    return value.toFixed(3).replace(".", scene.decimal).replace("-", "−");
  }
  function draw() {
    const ratio = window.devicePixelRatio || 1, style = getComputedStyle(root);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    canvas.width = ratio * canvas.clientWidth;
    canvas.height = ratio * canvas.clientHeight;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    context.lineCap = context.lineJoin = "round";
    const base = [0, 0, 0], reach = 0.12 * size;
    "xyz".split("").forEach((name, k) => {
      const tip = project(base.map((v, i) => (i === k ? reach : 0)));
      line([project(base), tip], colour("soft"), 1);
      context.fillStyle = colour("soft");
      context.font = "12px system-ui, sans-serif";
      context.fillText(name, tip[0] + 4, tip[1] + 4);
    });
    if (inputs.arm && inputs.arm.checked) {
      const rods = arm.map(project);
      line(rods, colour("arm"), 7);
      rods.forEach((p) => dot(p, 4, colour("ink")));
    }
    places = scene.p.map(project);
    const times = 10 ** Number(slider.value);
    for (const state of ["before", "after"]) {
      if (!inputs[state].checked) continue;
      const e = scene[state];
      scene.p.forEach((p, i) => arrow(places[i], project(p.map((v, k) => v + times * e[i][k])), colour(state)));
    }
    places.forEach((p, i) => dot(p, i === near ? 5 : 1.8, colour(i === near ? "ink" : "soft")));
    root.querySelector(".times").textContent = `× ${Number(times.toPrecision(2))}`;
    const e = (state) => number(Math.hypot(...scene[state][near]));
    told.textContent =
      near < 0
        ? scene.words.hint
        : `${scene.words.pose} ${near + 1}: x ${number(scene.p[near][0])}, y ${number(scene.p[near][1])}, z ${number(scene.p[near][2])} mm; ` +
          `${scene.words.before} ${e("before")} mm, ${scene.words.after} ${e("after")} mm`;
  }
  canvas.addEventListener("pointerdown", (event) => {
    drag = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointerup", () => (drag = null));
  canvas.addEventListener("pointermove", (event) => {
    if (drag) {
      turn += (event.clientX - drag[0]) / 150;
      tilt = Math.max(-1.57, Math.min(1.57, tilt + (event.clientY - drag[1]) / 150));
      drag = [event.clientX, event.clientY];
    } else {
      const distances = places.map((p) => Math.hypot(p[0] - event.offsetX, p[1] - event.offsetY));
      const least = Math.min(...distances);
      near = least < 14 ? distances.indexOf(least) : -1;
    }
    draw();
  });
  canvas.addEventListener(
    "wheel",
    (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return; // the page scrolls
      event.preventDefault();
      zoom = Math.max(0.3, Math.min(12, zoom * Math.exp(-event.deltaY / 600)));
      draw();
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (step) {
      turn += step[0];
      tilt = Math.max(-1.57, Math.min(1.57, tilt + step[1]));
    } else if (event.key === "+" || event.key === "-") zoom *= event.key === "+" ? 1.15 : 1 / 1.15;
    else return;
    event.preventDefault();
    draw();
  });
  root.addEventListener("input", draw);
  addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  draw();
}
