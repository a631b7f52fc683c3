// The page: connection, numbers, plots, mission, messages, commands.

document.addEventListener("DOMContentLoaded", () => {
  const $ = (name) => document.getElementById(name);
  const settings = JSON.parse($("settings").textContent);
  const token = location.hash.slice(1);
  const RETRY = 1000;
  const QUIET = 2000;
  const MESSAGES = 200;
  const SAMPLES = 6000;
  const at = Object.fromEntries(settings.columns.map((name, index) => [name, index]));
  let state = {}, mission = [], samples = [], received = -Infinity, link = null, span = 120, wing = null, isNew = true, isDue = true;

  // --- plots ------------------------------------------------------------------------------------------------------
  const degrees = (value) => (finite(value) ? value / DEGREE : null);
  const PLOTS = [
    ["altitude", "m", [["altitude", "altitude", "estimate"], ["setpoint", "altitude_setpoint", "setpoint"]]],
    ["airspeed", "m/s", [["airspeed", "airspeed", "estimate"]]],
    ["attitude", "°", [["roll", "roll", "left", degrees], ["pitch", "pitch", "right", degrees]]],
    ["flapping frequency", "Hz", [["frequency", "flap_frequency", "estimate"]]],
    ["power", "W", [["power", "power", "estimate"]]],
  ];
  const plots = PLOTS.map(([title, unit, lines]) => {
    const box = document.createElement("div"), head = document.createElement("div");
    head.className = "title";
    head.append(element("b", `${title} [${unit}]`));
    const readings = lines.map(([name, , role]) => {
      const entry = document.createElement("span"), key = document.createElement("i"), value = document.createElement("output");
      key.className = role;
      key.style.borderColor = `var(--${role})`;
      if (lines.length > 1) entry.append(key, `${name} `);
      entry.append(value);
      head.append(entry);
      return value;
    });
    box.append(head);
    $("plots").append(box);
    const series = lines.map(([, , role]) => ({
      stroke: () => color(role), width: 1.5, points: { show: false }, dash: role === "setpoint" ? [5, 4] : undefined,
    }));
    const plot = new uPlot({
      width: box.clientWidth || 320,
      height: 104,
      scales: { x: { time: false, range: (u, low, high) => range(low, high) } },
      axes: [axis("x"), { ...axis("y"), size: 44, space: 20 }],
      series: [{}, ...series],
      legend: { show: false },
      cursor: { sync: { key: "time" }, y: false, points: { size: 5 } },
      padding: [4, 10, 0, 0],
      hooks: { setCursor: [(u) => show(u)] },
    }, [[], ...lines.map(() => [])], box);
    const show = (u) => readings.forEach((output, n) => {
      const data = u.data[n + 1], index = u.cursor.idx ?? data.length - 1;
      output.textContent = shortNumber(data[index] ?? null);
    });
    return { plot, box, lines, show };
  });

  function range(low, high) {
    const end = high ?? 0;
    return [Math.max(low ?? 0, end - span), Math.max(end, (low ?? 0) + 1)];
  }

  function drawPlots() {
    const end = samples.length ? samples[samples.length - 1][at.time] : 0;
    const shown = samples.filter((row) => row[at.time] >= end - span);
    const time = shown.map((row) => row[at.time]);
    for (const { plot, lines, show } of plots) {
      plot.setData([time, ...lines.map(([, name, , scaled = (value) => value]) => shown.map((row) => scaled(row[at[name]])))]);
      show(plot);
    }
  }

  // --- vibration --------------------------------------------------------------------------------------------------
  // Amplitude on a logarithmic scale; the legend has the RMS of each axis.
  const AXES = [["x", "left"], ["y", "good"], ["z", "estimate"]];
  const LEASE = 4000;
  const LEAST = 1e-3;
  let spectrum = null, spectrumPlot = null;

  const decade = (value) => (Math.abs(Math.log10(value) - Math.round(Math.log10(value))) < 1e-6 ? String(value) : null);

  function drawSpectrum() {
    if (!$("vibration").open) return;
    $("spectrum").replaceChildren();
    spectrumPlot = null;
    const head = document.createElement("div");
    head.className = "title dim";
    $("spectrum").append(head);
    if (!spectrum) {
      head.textContent = token ? "waiting for HIGHRES_IMU" : "starts when a browser with the token opens it";
      return;
    }
    head.append(`acceleration [m/s²] over frequency [Hz], ${spectrum.rate.toFixed(0)} samples/s; RMS `);
    for (const [name, role] of AXES) {
      const key = document.createElement("b");
      key.style.color = `var(--${role})`;
      key.textContent = ` ${name} ${spectrum.rms[name].toFixed(2)}`;
      head.append(key);
    }
    spectrumPlot = new uPlot({
      width: $("spectrum").clientWidth || 320,
      height: 200,
      scales: { x: { time: false }, y: { distr: 3 } },
      axes: [axis("x"), { ...axis("y"), size: 52, values: (u, splits) => splits.map(decade) }],
      series: [{}, ...AXES.map(([, role]) => ({ stroke: () => color(role), width: 1.3, points: { show: false } }))],
      legend: { show: false },
      padding: [4, 10, 0, 0],
    }, [spectrum.frequency, ...AXES.map(([name]) => spectrum.amplitude[name].map((value) => Math.max(value, LEAST)))], $("spectrum"));
  }

  function wantSpectrum() {
    if ($("vibration").open && token && link?.readyState === WebSocket.OPEN) send("spectrum");
  }

  $("vibration").addEventListener("toggle", () => { wantSpectrum(); drawSpectrum(); });
  setInterval(wantSpectrum, LEASE);

  // --- numbers ----------------------------------------------------------------------------------------------------
  const percent = (value) => text(100 * value, 0, " %");
  const NUMBERS = [
    ["climb", (s) => text(s.climb_rate, 1, " m/s")],
    ["ground speed", (s) => text(s.groundspeed, 1, " m/s")],
    ["home", (s) => text(Math.hypot(s.north, s.east), 0, " m")],
    ["roll", (s) => text(s.roll / DEGREE, 0, "°")],
    ["pitch", (s) => text(s.pitch / DEGREE, 0, "°")],
    ["item", (s) => (s.distance > 0 && finite(s.item) ? `${s.item} · ${text(s.distance, 0, " m")}` : text(s.item, 0))],
    ["throttle", (s) => percent(s.throttle)],
    ["power", (s) => text(s.power, 1, " W")],
    ["supply", (s) => `${text(s.voltage, 2, " V")} ${finite(s.current) ? text(s.current, 1, " A") : ""}`],
    ["battery", (s) => percent(s.battery_remaining)],
    ["energy", (s) => text(s.energy, 0, " J")],
    ["GPS", (s) => `${s.fix || "–"}${finite(s.satellites) ? ` · ${s.satellites}` : ""}`],
  ];
  const outputs = NUMBERS.map(([name]) => {
    const pair = document.createElement("div"), value = element("dd", "–");
    pair.append(element("dt", name), value);
    $("numbers").append(pair);
    return value;
  });
  const known = (s) => Object.fromEntries(Object.entries(s).map(([key, value]) => [key, value ?? NaN]));

  function drawNumbers() {
    const given = { ...known(state), fix: state.fix };
    NUMBERS.forEach(([, format], n) => { outputs[n].textContent = format(given); });
    $("vehicle").textContent = state.name || "no vehicle";
    $("clock").textContent = finite(state.time) ? clock(state.time) : "–";
    badge($("armed"), state.armed == null ? "" : state.armed ? "ARMED" : "disarmed", state.armed);
    badge($("mode"), (state.mode ?? "").replaceAll("_", " "), false);
    $("stage").textContent = (state.stage ?? "").toLowerCase().replaceAll("_", " ");
    $("exciting").hidden = !state.exciting;
  }

  function badge(place, words, isOn) {
    place.hidden = !words;
    place.textContent = words;
    place.classList.toggle("on", Boolean(isOn));
  }

  function drawLink() {
    const gone = performance.now() - received > QUIET, given = state.link ?? {};
    const parts = [given.url];
    if (finite(given.bytes_per_s)) parts.push(`${text(given.bytes_per_s / 1000, 1)} kB/s`);
    if (finite(given.loss)) parts.push(`${text(100 * given.loss, 1)} % lost`);
    if (finite(given.latency)) parts.push(`${text(1000 * given.latency, 0)} ms`);
    if (!token) parts.push("view only: commands need the complete address that the command printed");
    let words = parts.filter(Boolean).join("  ·  ");
    if (gone) words = received > 0 ? "ground station not reachable" : "connecting to the ground station";
    else if (given.silence == null) words = `waiting for a vehicle on ${given.url}`;
    else if (given.lost) words = `no telemetry for ${text(given.silence, 0)} s`;
    const isLost = gone || given.lost || given.silence == null;
    $("link").textContent = words;
    $("link").classList.toggle("lost", Boolean(isLost));
    document.body.classList.toggle("stale", Boolean(isLost));
    for (const control of document.querySelectorAll("#commands button, #commands select, #reload")) {
      control.disabled = gone || !token || !state.name;
    }
  }

  // --- mission and messages -----------------------------------------------------------------------------------------
  function drawMission() {
    const rows = mission.map((item, number) => {
      const row = document.createElement("tr"), what = element("td", item.does);
      const place = finite(item.north) ? `${meters(item.north, "N", "S")} ${meters(item.east, "E", "W")}` : item.place;
      what.append(element("small", [item.altitude, place, item.how].filter(Boolean).join("  ·  ")));
      row.append(element("td", number), what);
      return row;
    });
    if (!rows.length) {
      const row = document.createElement("tr"), cell = element("td", "no mission downloaded");
      cell.colSpan = 2;
      row.append(cell);
      rows.push(row);
    }
    $("mission").replaceChildren(...rows);
    markItem(true);
  }

  function meters(value, positive, negative) {
    return `${Math.abs(value).toFixed(0)} m ${value < 0 ? negative : positive}`;
  }

  let marked = null;
  function markItem(again) {
    if (!again && marked === state.item) return;
    marked = state.item;
    [...$("mission").rows].forEach((row, number) => {
      row.classList.toggle("active", mission.length > 0 && number === marked);
      if (row.classList.contains("active")) {
        const box = row.closest(".scroll");
        box.scrollTop = row.offsetTop - box.clientHeight / 2;
      }
    });
  }

  function addMessages(message) {
    const kind = (severity) => (severity <= 3 ? "alarm" : severity === 4 ? "warning" : "");
    const entries = [
      ...message.events.map((one) => [one.time, one.text, kind(one.severity)]),
      ...message.notes.map((one) => [one.time, one.text, one.failed ? "alarm ground" : "ground"]),
    ];
    entries.sort(([one], [other]) => (one ?? 0) - (other ?? 0));
    for (const [time, words, className] of entries) {
      const entry = document.createElement("li");
      entry.className = className;
      entry.append(element("time", finite(time) ? clock(time) : "–"), element("span", words));
      $("events").prepend(entry);
    }
    while ($("events").children.length > MESSAGES) $("events").lastChild.remove();
    const last = message.notes[message.notes.length - 1];
    if (message.busy) result(`${message.busy} …`, "busy");
    else if (last && !isNew) result(last.text, last.failed ? "failed" : "");
    else if ($("result").className === "busy") result("", "");
  }

  function result(words, className) {
    $("result").textContent = words;
    $("result").className = className;
  }

  function drawModes() {
    const names = state.modes ?? [], choice = $("modes");
    const present = [...choice.options].map((option) => option.value);
    if (names.join() === present.join()) return;
    choice.replaceChildren(...names.map((name) => {
      const option = element("option", name.replaceAll("_", " "));
      option.value = name;
      return option;
    }));
    if (names.includes(state.mode)) choice.value = state.mode;
  }

  // --- commands -----------------------------------------------------------------------------------------------------
  function confirmed(question, warning, act) {
    $("question").textContent = question;
    $("warning").textContent = warning;
    $("confirmation").returnValue = "no";
    $("confirmation").onclose = () => { if ($("confirmation").returnValue === "yes") act(); };
    $("confirmation").showModal();
  }

  function send(command, argument = "") {
    if (link?.readyState === WebSocket.OPEN) link.send(JSON.stringify({ token, command, argument }));
    else result(`${command}: ground station not reachable`, "failed");
  }

  for (const button of document.querySelectorAll("[data-order]")) {
    const name = button.dataset.order, order = settings.orders[name];
    button.addEventListener("click", () => (order ? confirmed(order.question, order.warning, () => send(name)) : send(name)));
  }
  $("set").addEventListener("click", () => {
    const name = $("modes").value;
    confirmed(`Change to ${name.replaceAll("_", " ")}?`, "", () => send("mode", name));
  });
  for (const button of document.querySelectorAll("[data-span]")) {
    button.addEventListener("click", () => {
      span = Number(button.dataset.span);
      document.querySelectorAll("[data-span]").forEach((one) => one.setAttribute("aria-pressed", String(one === button)));
      drawPlots();
    });
  }

  // --- connection ---------------------------------------------------------------------------------------------------
  function receive(message) {
    received = performance.now();
    if (message.restart) samples = [];
    samples.push(...message.samples);
    if (samples.length > 1.1 * SAMPLES) samples = samples.slice(-SAMPLES);
    if (message.mission) mission = message.mission;
    const { flap_phase: phase, flap_frequency: frequency, flap_left: left } = message;
    if (phase !== state.flap_phase || left !== state.flap_left) wing = { phase, frequency, since: received };
    state = message;
    if (isNew) $("events").replaceChildren();
    drawNumbers();
    drawModes();
    addMessages(message);
    if (message.mission) drawMission();
    if (message.spectrum !== undefined) { spectrum = message.spectrum; drawSpectrum(); }
    markItem(false);
    if (message.samples.length || isNew) drawPlots();
    isNew = false;
    isDue = true;
  }

  function connect() {
    link = new WebSocket(`ws://${location.host}${settings.socket}`);
    isNew = true;
    link.onmessage = (event) => receive(JSON.parse(event.data));
    link.onclose = () => setTimeout(connect, RETRY);
  }

  // Between two messages the phase is extrapolated with the flapping frequency.
  function phaseNow() {
    if (!wing || !finite(wing.phase) || !(wing.frequency > 0)) return null;
    return wing.phase + TURN * wing.frequency * Math.min((performance.now() - wing.since) / 1000, 1);
  }

  function draw() {
    wings($("wings"), state, phaseNow());
    if (isDue) {
      const places = samples.map((row) => [row[at.north], row[at.east]]);
      instruments($("instruments"), state);
      track($("track"), places.filter((place) => place.every(finite)), mission, state);
      isDue = false;
    }
    requestAnimationFrame(draw);
  }

  new ResizeObserver(() => {
    for (const { plot, box } of plots) plot.setSize({ width: box.clientWidth || 320, height: 104 });
    spectrumPlot?.setSize({ width: $("spectrum").clientWidth || 320, height: 200 });
    isDue = true;
  }).observe($("plots"));
  window.addEventListener("hashchange", () => location.reload());
  setInterval(drawLink, 200);
  drawMission();
  drawLink();
  connect();
  requestAnimationFrame(draw);
});

function element(kind, words) {
  const made = document.createElement(kind);
  made.textContent = words;
  return made;
}

function clock(seconds) {
  const tenths = Math.round(seconds * 10), digits = (value) => String(value).padStart(2, "0");
  return `${digits(Math.floor(tenths / 600))}:${digits(Math.floor(tenths / 10) % 60)}.${tenths % 10}`;
}
