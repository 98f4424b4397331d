// The front end of `voxsplat.notebook.Viewer`. A message to the kernel has the values that the user changed, and
// `moving` while they change. The kernel answers a moving view with a small PNG, and a still one with the trait
// `_picture`.

// Milliseconds without a change after which a view is still.
const REST = 250;
// Magnification of a unit of the wheel; a notch has about 100.
const WHEEL = 1.001;
// Degrees that an arrow key turns.
const STEP = 15;
const STYLE = `
.voxsplat { display: inline-block; max-width: 100%; font: 13px sans-serif; }
.voxsplat img { display: block; max-width: 100%; cursor: grab; touch-action: none; user-select: none; }
.voxsplat img:active { cursor: grabbing; }
.voxsplat div { display: flex; flex-wrap: wrap; gap: 2px 12px; align-items: center; padding: 4px 0; }
.voxsplat label { display: flex; gap: 4px; align-items: center; }
.voxsplat input { width: 100px; }
.voxsplat output { min-width: 4em; }
.voxsplat p { color: #b00020; margin: 0; }`;

function add(parent, name, fields) {
  const made = Object.assign(document.createElement(name), fields);
  parent.append(made);
  return made;
}

function render({ model, el }) {
  const [width, height] = model.get("_size");
  const first = model.get("_first");
  const root = add(el, "div", { className: "voxsplat" });
  add(root, "style", { textContent: STYLE });
  const picture = add(root, "img", { tabIndex: 0, draggable: false, alt: "A volume that turns when it is dragged" });
  Object.assign(picture.style, { width: `${width}px`, aspectRatio: `${width} / ${height}` });
  const bar = add(root, "div", {});
  const fault = add(root, "p", {});
  fault.setAttribute("role", "alert");

  // The values here, the ones that the kernel does not know yet, and the picture of them that is to be requested.
  const view = {};
  let changed = {};
  let wanted = null;
  // The picture that was requested and has not come: "moving", "still" or null.
  let awaited = null;
  let grabbed = null;
  let timer = 0;
  const controls = [];

  function show(bytes) {
    const last = picture.src;
    picture.src = URL.createObjectURL(new Blob([bytes], { type: "image/png" }));
    URL.revokeObjectURL(last);
  }
  // Values wait for the moving picture that is under way, so that no messages queue up. They overtake a still one.
  function send() {
    if (wanted && awaited !== "moving") {
      awaited = wanted;
      wanted = null;
      model.send({ ...changed, moving: awaited === "moving" });
      changed = {};
    }
  }
  function request(values, moving) {
    Object.assign(view, values);
    Object.assign(changed, values);
    wanted = moving ? "moving" : "still";
    clearTimeout(timer);
    timer = moving ? setTimeout(() => request({}, false), REST) : 0;
    send();
    // Drags change no control.
    if (!grabbed) {
      controls.forEach((update) => update());
    }
  }
  // Takes the kernel's values, unless the user has newer ones.
  function adopt() {
    if (!grabbed && !wanted && !awaited) {
      for (const name of ["azimuth", "elevation", "zoom", "window", "time", "transfer"]) {
        view[name] = model.get(name);
      }
      controls.forEach((update) => update());
    }
  }
  function turn(azimuth, elevation, moving) {
    const turned = ((((azimuth + 180) % 360) + 360) % 360) - 180;
    request({ azimuth: turned, elevation: Math.max(-90, Math.min(90, elevation)) }, moving);
  }

  picture.addEventListener("pointerdown", (event) => {
    if (event.isPrimary && event.button === 0) {
      grabbed = { x: event.clientX, y: event.clientY, azimuth: view.azimuth, elevation: view.elevation };
      picture.setPointerCapture(event.pointerId);
    }
  });
  // The width of the picture is half a turn: matter in front follows the pointer.
  picture.addEventListener("pointermove", (event) => {
    if (grabbed && event.isPrimary) {
      const degrees = 180 / picture.clientWidth;
      const [x, y] = [event.clientX - grabbed.x, event.clientY - grabbed.y];
      turn(grabbed.azimuth - degrees * x, grabbed.elevation + degrees * y, true);
    }
  });
  for (const name of ["pointerup", "pointercancel"]) {
    picture.addEventListener(name, (event) => {
      if (grabbed && event.isPrimary) {
        grabbed = null;
        request({}, false);
      }
    });
  }
  picture.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 33 : 1;
    request({ zoom: Math.max(0.1, Math.min(100, view.zoom * WHEEL ** (-lines * event.deltaY))) }, true);
  });
  picture.addEventListener("dblclick", () => request(first, false));
  picture.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (turns && !event.ctrlKey && !event.altKey && !event.metaKey) {
      // Notebooks change cells by arrow keys.
      event.preventDefault();
      event.stopPropagation();
      turn(view.azimuth + STEP * turns[0], view.elevation + STEP * turns[1], true);
    }
  });

  // A slider over `low` to `high`; `value` reads its place from the view, and `values` are the values of a place.
  function slider(text, [low, high, step], value, values) {
    const label = add(bar, "label", { textContent: text });
    const input = add(label, "input", { type: "range", min: low, max: high, step });
    const output = add(label, "output", {});
    input.addEventListener("input", () => request(values(Number(input.value)), true));
    input.addEventListener("change", () => request({}, false));
    controls.push(() => {
      input.value = value();
      output.textContent = Number(Number(value()).toPrecision(4));
    });
  }
  const [low, high] = model.get("_range");
  if (high > low) {
    const step = (high - low) / 1000;
    const window = () => view.window ?? [(low + high) / 2, high - low];
    slider("Level", [low, high, step], () => window()[0], (level) => ({ window: [level, window()[1]] }));
    slider("Width", [step, high - low, step], () => window()[1], (width) => ({ window: [window()[0], width] }));
  }
  const times = model.get("_times");
  if (times > 1) {
    slider("Time", [0, times - 1, 1], () => view.time, (time) => ({ time }));
  }
  const names = model.get("_transfers");
  const select = add(bar, "select", { title: "Transfer function" });
  [first.transfer, ...names.filter((name) => name !== first.transfer)].forEach((name) => {
    add(select, "option", { value: name, textContent: name || "default" });
  });
  select.addEventListener("change", () => request({ transfer: select.value, window: first.window }, false));
  controls.push(() => {
    select.value = view.transfer;
  });
  const reset = add(bar, "button", { type: "button", textContent: "Reset", title: "The first view and look" });
  reset.addEventListener("click", () => request(first, false));

  function drawn() {
    show(model.get("_picture"));
  }
  function heard({ error, moving }, buffers) {
    awaited = null;
    fault.textContent = error ?? "";
    if (moving) {
      show(buffers[0]);
    }
    send();
    adopt();
  }
  model.on("change:_picture", drawn);
  model.on("msg:custom", heard);
  adopt();
  drawn();
  // The kernel draws the picture if there is none yet, and prepares for moving ones.
  request({}, false);
  return () => {
    clearTimeout(timer);
    model.off("change:_picture", drawn);
    model.off("msg:custom", heard);
    URL.revokeObjectURL(picture.src);
  };
}

export default { render };
