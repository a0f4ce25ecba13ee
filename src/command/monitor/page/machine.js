// The machine from the side: bodies, cylinders, teeth with their way, and where the references put the teeth.
"use strict";

const Machine = (() => {
  const NAMES = "http://www.w3.org/2000/svg";
  // Points of the way of the teeth: 15 s.
  const WAY = 150;
  let parts = null;
  let way = [];

  function add(parent, name, className) {
    const node = document.createElementNS(NAMES, name);
    node.setAttribute("class", className);
    parent.append(node);
    return node;
  }

  // `view`: lowest x, lowest z, highest x, highest z, m; null for a machine that is not drawn.
  function begin(view) {
    const drawing = document.getElementById("drawing");
    document.getElementById("pose").hidden = !view;
    drawing.replaceChildren();
    parts = null;
    way = [];
    if (!view) return;
    const [left, bottom, right, top] = view;
    drawing.setAttribute("viewBox", `${left} ${-top} ${right - left} ${top - bottom}`);
    // z is up; the vertical of a drawing is down.
    const up = add(drawing, "g", "up");
    up.setAttribute("transform", "scale(1 -1)");
    const ground = add(up, "path", "ground");
    ground.setAttribute("d", `M${left} 0H${right}`);
    parts = {
      bodies: [0, 1, 2].map(() => add(up, "path", "body")),
      cylinders: [0, 1, 2].map(() => add(up, "path", "cylinder")),
      links: add(up, "path", "links"),
      way: add(up, "path", "way"),
      tip: add(up, "circle", "tip"),
      target: add(up, "circle", "target"),
    };
    parts.tip.setAttribute("r", "0.09");
    parts.target.setAttribute("r", "0.17");
  }

  const path = (points) => "M" + points.map((point) => point.join(" ")).join("L");

  function place(circle, point) {
    circle.toggleAttribute("hidden", !point);
    circle.style.display = point ? "" : "none";
    if (!point) return;
    circle.setAttribute("cx", point[0]);
    circle.setAttribute("cy", point[1]);
  }

  function draw(pose) {
    if (!parts || !pose) return;
    parts.bodies.forEach((node, i) => node.setAttribute("d", path(pose.bodies[i]) + "Z"));
    parts.cylinders.forEach((node, i) => node.setAttribute("d", path(pose.cylinders[i])));
    parts.links.setAttribute("d", path(pose.links));
    way.push(pose.tip);
    if (way.length > WAY) way.shift();
    parts.way.setAttribute("d", path(way));
    place(parts.tip, pose.tip);
    place(parts.target, pose.target);
  }

  return { begin, draw };
})();
