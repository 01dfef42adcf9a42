// The page: draws what the server sends, and sends what the user does. Which pixel a click is on, the server says.
"use strict";

const $ = (id) => document.getElementById(id);
const canvas = $("picture"), pen = canvas.getContext("2d");
const state = { frame: null, bitmap: null, place: null, pick: null, step: null, settings: null, isConnected: false, drawn: 0 };
window.warprt = state;
let socket = null, arrived = 0;

function say(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function connect() {
  const address = new URL("live", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.search = "";
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    state.isConnected = true;
    status("");
    if (state.isWeak) say({ type: "weak" }); // the server may be another one by now
    measure();
  };
  socket.onmessage = (event) => {
    if (event.data instanceof ArrayBuffer) return receiveFrame(event.data);
    const message = JSON.parse(event.data);
    if (receivers[message.type]) receivers[message.type](message);
  };
  socket.onclose = () => {
    if (state.isConnected) status("The viewer does not answer. Trying again ...", true);
    state.isConnected = false;
    setTimeout(connect, 1000);
  };
}

const receivers = {
  setup(message) {
    $("name").textContent = message.name;
    document.title = `${message.name} - warprt`;
    state.size = message.size;
    for (const [name, values] of Object.entries(message.choices)) {
      const select = $("settings").elements[name];
      select.replaceChildren(...values.map((value) => new Option(value.replaceAll("_", " "), value)));
    }
    receivers.notes(message);
  },
  notes(message) {
    $("remarks").replaceChildren(...message.notes.map((note) => make("li", note)));
  },
  settings(message) {
    state.settings = message;
    for (const element of $("settings").elements) if (element.name in message) element.value = message[element.name];
  },
  place(message) { state.place = message; draw(); },
  pick(message) { state.pick = message.pixel ? message : null; showPick(); draw(); },
  step(message) { state.step = message.index; showStep(); },
  busy(message) { status(message.text); },
  error(message) { status(message.text, true); },
  camera(message) { copyText(message.text); },
};

async function receiveFrame(buffer) {
  const number = ++arrived, length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const blob = new Blob([new Uint8Array(buffer, 4 + length)], { type: header.kind });
  const bitmap = await createImageBitmap(blob);
  // A small picture may be decoded before a large one that came earlier.
  if (number < state.drawn) return;
  state.drawn = number;
  state.bitmap = bitmap;
  state.frame = header;
  draw();
  requestAnimationFrame(() => setTimeout(openWindows));
  const most = header.most === null ? "" : `, brightest: ${header.most}`;
  const part = header.step > 1 ? `coarse, 1/${header.step}` : header.output === "color" ? `${header.samples} samples` : "";
  const done = header.is_final ? "" : " ...";
  $("progress").textContent = `${header.size[0]} x ${header.size[1]} ${header.output.replaceAll("_", " ")} ${part}${most}${done}`;
}

function hasGpu() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl && gl.getExtension("WEBGL_debug_renderer_info");
  const isWeak = names && /swiftshader|llvmpipe|software/i.test(gl.getParameter(names.UNMASKED_RENDERER_WEBGL));
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return !isWeak;
}

// The 3-D windows, which take a browser a second or more to set up: only after the first picture is there, and one by one.
async function openWindows() {
  if (state.isOpen) return;
  state.isOpen = true;
  // Without a GPU, fewer triangles and fewer pixels leave the page time for the rest.
  state.isWeak = !hasGpu();
  if (state.isWeak) say({ type: "weak" });
  for (const frame of document.querySelectorAll("iframe[data-src]")) {
    const loaded = new Promise((done) => frame.addEventListener("load", done, { once: true }));
    frame.src = frame.dataset.src + (state.isWeak ? "&fixedDpr=0.75" : "");
    await loaded;
  }
}

// Tells the server of the window's size; its answer says where the picture lies in a window of that size.
function measure() {
  const { width, height } = canvas.getBoundingClientRect();
  if (width && height) say({ type: "window", width, height, ratio: window.devicePixelRatio || 1 });
}

function draw() {
  if (!state.place || !state.bitmap) return;
  const place = state.place, { width, height, ratio } = place.window;
  const across = Math.max(1, roundEven(width * ratio)), down = Math.max(1, roundEven(height * ratio));
  if (canvas.width !== across || canvas.height !== down) { canvas.width = across; canvas.height = down; }
  pen.clearRect(0, 0, across, down);
  // Pixels are to be seen as such where they are enlarged.
  pen.imageSmoothingEnabled = place.width < state.bitmap.width;
  pen.imageSmoothingQuality = "high";
  pen.drawImage(state.bitmap, place.left, place.top, place.width, place.height);
  if (state.pick && state.frame && state.pick.view === state.frame.view) drawCross(place);
  $("hint").hidden = Boolean(state.pick);
}

// As Python rounds, who says where the picture lies.
function roundEven(x) {
  const low = Math.floor(x);
  return x - low === 0.5 ? low + (low % 2) : Math.round(x);
}

function drawCross(place) {
  const [column, row] = state.pick.pixel, [width, height] = state.frame.size;
  const x = place.left + ((column + 0.5) * place.width) / width, y = place.top + ((row + 0.5) * place.height) / height;
  const ratio = place.window.ratio, gap = Math.max(4 * ratio, place.width / width), arm = gap + 9 * ratio;
  for (const [color, thickness] of [["rgba(255,255,255,0.9)", 4], ["#e11e28", 2]]) {
    pen.strokeStyle = color;
    pen.lineWidth = thickness * ratio;
    pen.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      pen.moveTo(x + gap * dx, y + gap * dy);
      pen.lineTo(x + arm * dx, y + arm * dy);
    }
    pen.stroke();
  }
}

function make(tag, text, className) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (className) element.className = className;
  return element;
}

function status(text, isBad = false) {
  $("status").textContent = text;
  $("status").className = isBad ? "bad" : "";
}

const digits = (number) => (typeof number === "number" ? String(Number(number.toPrecision(7))) : String(number));
const vector = (numbers) => `(${numbers.map((number) => digits(Number(number.toPrecision(5)))).join(", ")})`;

function showPick() {
  const pick = state.pick;
  $("pixel").textContent = pick ? `of pixel, column ${pick.pixel[0]}, row ${pick.pixel[1]}` : "";
  $("segments").replaceChildren(...(pick ? pick.segments.map(segmentTable) : []));
  $("count").textContent = pick ? cellCount(pick) : "";
  if (!pick) state.step = null;
  showStep();
}

function cellCount({ cells, drawn }) {
  return drawn < cells.length ? `${cells.length}, of which ${drawn} are drawn` : String(cells.length);
}

function segmentTable(segment, number) {
  const table = make("table"), title = number === 0 ? "from the eye" : `from mirror ${number}`;
  const rows = [["", `${title}, along ${vector(segment.direction)}`]];
  if (segment.is_hit) {
    const name = segment.name ? ` "${segment.name}"` : "";
    rows.push(["t", `${digits(segment.t)}  ± ${Number(segment.t_error).toPrecision(2)}`]);
    rows.push(["hits", `instance ${segment.instance_id}${name} (${segment.shape}), primitive ${segment.primitive_id}`
      + (segment.is_mirror ? ", a mirror" : "")]);
    rows.push(["at", `${vector(segment.position)}, normal ${vector(segment.normal)}`]);
  } else rows.push(["hits", "nothing"]);
  rows.push(["cells", `${segment.cells_visited} visited, ${segment.cells_jumped} jumped over; `
    + `${segment.triangles_tested} triangles tested`]);
  for (const [key, value] of rows) {
    const row = table.insertRow(), head = make("th", key);
    if (!key) { const dot = make("span", "", "dot"); dot.style.background = segment.color; head.append(dot); }
    row.append(head, make("td", value));
  }
  return table;
}

const WORDS = { jumped: "jumped over", empty: "empty", tested: "tested", found: "hit found" };
const MOST_ROWS = 400;

function showStep() {
  const cells = state.pick ? state.pick.cells : [], here = state.step ?? 0;
  const first = Math.max(0, Math.min(here - MOST_ROWS / 2, cells.length - MOST_ROWS));
  $("rows").replaceChildren(...cells.slice(first, first + MOST_ROWS).map((cell, k) => cellRow(cell, first + k)));
  $("at").textContent = cells.length && state.step !== null ? `${here + 1} of ${cells.length}` : "";
  for (const id of ["back", "on", "found", "zoom"]) $(id).disabled = !cells.length;
  $("clear").disabled = !state.pick;
  const row = $("rows").querySelector(".here");
  if (row) $("list").scrollTop = row.offsetTop - $("list").clientHeight / 2;
}

function cellRow([segment, instance, cell, tEnter, tExit, candidates, kind], index) {
  const row = make("tr", undefined, kind + (index === state.step ? " here" : "")), first = make("td");
  const dot = make("span", "", "dot");
  dot.style.background = state.pick.segments[segment].color;
  first.append(dot, String(index + 1));
  row.append(first, ...[instance, cell.join(" "), digits(tEnter), digits(tExit), candidates, WORDS[kind]].map((text) => make("td", text)));
  row.onclick = () => say({ type: "step", to: index });
  return row;
}

function toFound() {
  const index = state.pick ? state.pick.cells.findIndex((cell) => cell[6] === "found") : -1;
  if (index >= 0) say({ type: "step", to: index });
}

async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
    status(`Copied: ${text}`);
  } catch {
    status(text);
  }
  state.copied = text;
}

async function save() {
  const answer = await fetch("picture.png");
  if (!answer.ok) return status(await answer.text(), true);
  const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") || "");
  const link = make("a");
  link.href = URL.createObjectURL(await answer.blob());
  link.download = name ? name[1] : "picture.png";
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const KEYS = {
  ".": () => say({ type: "step", by: 1 }), ",": () => say({ type: "step", by: -1 }), f: toFound,
  z: () => say({ type: "zoom" }),
  Escape: () => say({ type: "clear" }),
};

function onKey(event) {
  const isField = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
  if (isField || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
}

canvas.addEventListener("pointerdown", (event) => {
  document.activeElement?.blur(); // so that keys are no longer for a field
  if (event.button !== 0 || !event.shiftKey) return;
  event.preventDefault();
  if (!state.place || !state.frame) return;
  // By the window that the picture was drawn for: until it is drawn anew, a resized canvas is that one stretched.
  const box = canvas.getBoundingClientRect(), drawn = state.place.window;
  const x = ((event.clientX - box.left) * drawn.width) / box.width, y = ((event.clientY - box.top) * drawn.height) / box.height;
  status("");
  say({ type: "pick", x, y, ...drawn, view: state.frame.view });
});
for (const kind of ["keydown", "keyup"]) addEventListener(kind, (event) => canvas.classList.toggle("aims", event.shiftKey));
canvas.addEventListener("pointermove", (event) => canvas.classList.toggle("aims", event.shiftKey));
$("settings").addEventListener("change", (event) => {
  const { name, value, type } = event.target;
  status("");
  say({ type: "set", name, value: type === "number" ? Number(value) : value });
});
$("settings").addEventListener("submit", (event) => event.preventDefault());
$("home").onclick = () => say({ type: "home" });
$("copy").onclick = () => say({ type: "camera" });
$("save").onclick = save;
$("back").onclick = KEYS[","];
$("on").onclick = KEYS["."];
$("found").onclick = toFound;
$("zoom").onclick = KEYS.z;
$("clear").onclick = KEYS.Escape;
addEventListener("keydown", onKey);
// Keys step on also while one of the 3-D windows has the focus; it has no use for these.
for (const frame of document.querySelectorAll("iframe")) {
  frame.addEventListener("load", () => frame.contentWindow?.addEventListener("keydown", onKey));
}
new ResizeObserver(measure).observe($("window"));
addEventListener("resize", measure);
showPick();
connect();
