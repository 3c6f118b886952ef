/* Copyright 2026 rpms_ros contributors */
/* SPDX-License-Identifier: Apache-2.0 */
/* The page: takes frames, asks for the next, draws.  Texts go into the page as text only. */
(function () {
  'use strict';
  const element = (id) => document.getElementById(id);
  const calm = matchMedia('(prefers-reduced-motion: reduce)');
  // a screen of 60 Hz draws every second time
  const DRAW_PERIOD = 30;
  const TEXT_PERIOD = 500, CALM_PERIOD = 1000, RETRY = 1000, SILENCE = 3000,
    HIDDEN_PERIOD = 1000, PATIENCE = 2000;
  const SENDING = 'stop pressed, sending', UNANSWERED = 'NOT STOPPED by this page: its program does '
    + 'not answer; use the switch of the stimulator';
  const known = { unit: 'N', estimate: null, driver: null, topics: [], top: null, stop: { pressed: false, text: '' } };
  let token = '', held = false, canStop = false, socket = null, changed = true;
  let written = 0, drawn = 0, lastFrame = 0, pressedHere = '', drawnEstimate = null;

  const shown = (value, unit = '') => value === null || value === undefined ? 'not known'
    : `${Number(value.toPrecision(4))}${unit && ` ${unit}`}`;
  const bounded = (low, high) => typeof low === 'number' && typeof high === 'number';
  // a number with a band has the places that the band leaves it
  function within(value, low, high) {
    const half = (high - low) / 2;
    if (!bounded(low, high) || value === null || !(half > 0) || half > 1e4) { return shown(value); }
    const text = value.toFixed(Math.min(Math.max(1 - Math.floor(Math.log10(half)), 0), 9));
    return Number(text) === 0 ? text.replace('-', '') : text;
  }
  const band = (low, high, unit) => bounded(low, high)
    ? `${within(low, low, high)} to ${within(high, low, high)}${unit && ` ${unit}`}` : '';
  function write(id, text) {
    const place = element(id);
    if (place.textContent !== text) { place.textContent = text; }
  }
  function list(id, lines) {
    const made = lines.map((text) => {
      const item = document.createElement('li');
      item.textContent = text;
      return item;
    });
    element(id).replaceChildren(...made);
  }
  function rows(id, lines) {
    element(id).parentElement.hidden = !lines.length;
    element(id).replaceChildren(...lines.map((cells) => {
      const row = document.createElement('tr');
      cells.forEach((text, place) => {
        const cell = document.createElement(place ? 'td' : 'th');
        if (!place) { cell.scope = 'row'; }
        cell.textContent = text;
        row.append(cell);
      });
      return row;
    }));
  }
  function facts(id, pairs) {
    element(id).replaceChildren(...pairs.flatMap(([name, value]) => {
      const term = document.createElement('dt'), detail = document.createElement('dd');
      term.textContent = name;
      detail.textContent = value;
      return [term, detail];
    }));
  }

  // in words first; the name is that of the messages, the log and the documents
  const explained = ([name, why]) => why ? `${why} (${name})` : name;
  function writeEstimate(one) {
    const level = one.confidence ? `${Math.round(100 * one.confidence)} %` : '';
    write('estimate-text', `${one.estimator}: ${one.samples} samples, ${one.pulses} pulses, `
      + (one.output_error === null ? 'no error is stated at rest'
        : `error of the last second ${shown(100 * one.output_error, '%')}`));
    rows('parameter-rows', [...one.parameters, ...one.physiology].map(
      ([name, value, low, high, flag]) => [name, value === null ? '–' : within(value, low, high),
        band(low, high, '') || 'none', flag || '']));
    const curve = one.curve, response = one.response, unit = one.unit;
    const last = curve ? curve.force.length - 1 : 0;
    write('curve-text', curve ? `at full intensity, ${shown(one.rate, 'Hz')}: `
      + (curve.lower ? `${within(curve.force[last], curve.lower[last], curve.upper[last])} ${unit}; `
        + `${level} band ${band(curve.lower[last], curve.upper[last], unit)}`
        : `${shown(curve.force[last], unit)}; this estimator states no band`)
      : 'one intensity only so far: no curve');
    write('response-text', response ? `peak ${shown(Math.max(...response.force), unit)}`
      + (response.lower ? `; band ${level}` : '; this estimator states no band') : 'not known');
    write('disturbance', one.disturbance_deviation
      ? `force that the stimulation does not cause: ${within(one.disturbance,
        -one.disturbance_deviation, one.disturbance_deviation)} ${unit}, 95 % band ${band(
        one.disturbance - 1.96 * one.disturbance_deviation,
        one.disturbance + 1.96 * one.disturbance_deviation, unit)}` : '');
    rows('rate-rows', one.rates.map(([name, value, low, high]) =>
      [name, within(value, low, high), band(low, high, '') || 'none']));
    write('change-text', one.changes ? `${one.changes} sudden change${one.changes > 1 ? 's' : ''} since the start`
      : 'no sudden change found');
    list('change-list', one.marks.map(([kind, time]) => `${kind} at ${shown(time, 's')}`));
    write('doubt-text', known.top && known.top.old ? 'not known: these are of the last estimate, which is old'
      : one.doubts.length
      ? 'The numbers may be wrong by more than their bands say:' : 'no doubts');
    element('doubt-text').classList.toggle('alarm', one.doubts.length > 0);
    list('doubt-list', one.doubts.map(explained));
    element('doubtful').hidden = !one.doubts.length;
    list('reason-list', one.reasons);
    rows('fault-rows', one.faults.map(([name, count, why]) => [explained([name, why]),
      String(count)]));
  }
  function writeDriver(one) {
    const place = element('state'), word = document.createElement('strong');
    const text = `${one.state}${one.reason ? `: ${one.reason}` : ''}`;
    if (place.textContent !== text) {
      word.textContent = one.state;
      place.replaceChildren(word, one.reason ? `: ${one.reason}` : '');
    }
    place.classList.toggle('alarm', one.state === 'stopped' || one.state === 'fault');
    facts('driver-facts', [
      ['schedule', one.schedule ? `${one.schedule}, segment ${one.segment} of ${one.segments}`
        : 'none runs'],
      ['time left', shown(one.time_left, 's')],
      ['pulses', `${one.pulses_delivered} delivered, ${one.pulses_dropped} dropped, `
        + `${one.pulses_unverified} not confirmed by the device`],
      ['dose of the patient', `${one.dose_pulses} pulses, ${shown(one.dose_energy, 'J')}`],
      ['coil', `${shown(one.coil_energy, 'J')}, temperature ${shown(one.coil_temperature, '°C')}`],
      ['largest intensity', one.maximum_intensity === null ? 'not known'
        : `${shown(100 * one.maximum_intensity, '%')} of the stimulator's maximum`],
      ['largest lateness', shown(1000 * (one.lateness_max || 0), 'ms')],
      ['device', one.device || 'not known'],
      ['operator', one.operator_id ? `${one.operator_id}, enable ${one.enabled ? 'held' : 'not held'}`
        : 'nobody'],
      ['stop buttons', one.buttons.map(([name, state]) => `${name} ${state}`).join(', ') || 'none'],
      ['faults', one.faults.map(([name, count]) => `${name} ${count}`).join(', ') || 'none'],
    ]);
  }
  function writeTop(top, heard) {
    write('title', top.title);
    document.title = `${top.title}, live`;
    write('alarms', top.alarms.join('; '));
    write('next', top.next);
    document.body.classList.toggle('old', top.old);
    if (document.body.classList.toggle('waiting', Boolean(top.waiting))) {
      write('curve-text', top.waiting);
    } else { plots.resize(); }
    const one = known.driver;
    if (!one) { return; }
    write('glance', `${heard ? '' : 'old: '}${one.schedule
      ? `${one.time_left === null ? 'not known' : Math.ceil(one.time_left)} s left of ${one.schedule}` : 'no schedule runs'}; `
      + `dose ${one.dose_pulses} pulses, ${shown(one.dose_energy, 'J')}; `);
    write('lost', `${one.pulses_dropped} dropped, ${one.pulses_unverified} not confirmed`);
    element('lost').classList.toggle('some', one.pulses_dropped + one.pulses_unverified > 0);
  }
  function writeTopics(topics) {
    rows('topic-rows', topics.map((one) => [one.name,
      one.count ? shown(one.rate, 'Hz') : '–',
      // the text of a topic that is not ok begins with why
      one.state === 'ok' ? `ok${one.text ? `; ${one.text}` : ''}` : one.text]));
    const driver = topics[topics.length - 1];
    if (driver && (driver.refused
      || driver.state !== 'ok' && (!known.driver || driver.state !== 'quiet'))) {
      const text = known.driver
        ? `driver ${driver.text}; last state: ${known.driver.state}` : `driver not heard: ${driver.text}`;
      write('state', text);
      element('state').classList.toggle('alarm', Boolean(known.driver));
      return false;
    }
    return true;
  }
  function writeStop() {
    element('controls').hidden = !canStop;
    element('additional').hidden = !canStop;
    element('read-only').hidden = canStop;
    element('stop').hidden = !token;
    element('unlock').hidden = Boolean(token);
    element('let-go').hidden = !token || !known.stop.pressed;
    write('stopped', pressedHere || known.stop.text);
  }
  function writeTexts() {
    const heard = writeTopics(known.topics);
    if (known.top) { writeTop(known.top, heard); }
    if (known.driver && heard) { writeDriver(known.driver); }
    if (!held && known.estimate) { writeEstimate(known.estimate); }
    if (!held) {
      write('force-now', `measured ${shown(plots.newest('low'), known.unit)}, `
        + `modelled ${shown(plots.newest('modelled'), known.unit)}`);
    }
    writeStop();
  }
  function draw(now) {
    plots.drawForce(now / 1000);
    if (known.estimate !== drawnEstimate) {
      drawnEstimate = known.estimate;
      plots.mark(known.estimate.marks);
      plots.drawCurve('curve', known.estimate.curve);
      plots.drawCurve('response', known.estimate.response);
    }
  }

  function take(frame) {
    if (frame.session) {
      canStop = frame.session.can_stop;
      known.unit = frame.session.unit;
      plots.unit(known.unit);
    }
    if (frame.force) { plots.addForce(frame.force); }
    if (frame.pulses) { plots.addPulses(frame.pulses); }
    if (frame.disturbance) { plots.addEffort(frame.disturbance); }
    for (const name of ['estimate', 'driver', 'topics', 'top', 'stop']) {
      if (frame[name]) { known[name] = frame[name]; }
    }
    // that a stop has failed is shown until one is pressed, also over a new connection
    if (frame.stop && (frame.stop.pressed || !pressedHere.startsWith('NOT'))) { pressedHere = ''; }
    changed = true;
  }
  function update(now) {
    if (!held && now - drawn >= (calm.matches ? CALM_PERIOD : DRAW_PERIOD)) {
      drawn = now;
      draw(now);
    }
    if (changed && (now - written >= TEXT_PERIOD || known.stop.pressed)) {
      changed = false;
      written = now;
      writeTexts();
    }
  }
  function drawing(now) {
    update(now);
    requestAnimationFrame(drawing);
  }

  function connected(yes, text) {
    document.body.classList.toggle('lost', !yes);
    element('connection').classList.toggle('alarm', !yes);
    write('connection', text);
  }
  function connect() {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const made = new WebSocket(`${scheme}://${location.host}/stream`);
    socket = made;
    made.onopen = () => { lastFrame = performance.now(); connected(true, 'connected'); };
    made.onmessage = (event) => {
      lastFrame = performance.now();
      take(JSON.parse(event.data));
      // the next frame is asked for when the screen has drawn
      const next = () => {
        if (made.readyState === WebSocket.OPEN) { made.send('n'); }
      };
      if (document.hidden) { setTimeout(next, HIDDEN_PERIOD); } else { requestAnimationFrame(next); }
    };
    made.onclose = (event) => {
      const reason = event.reason ? `: ${event.reason}` : '';
      connected(false, `no connection to the page's program${reason}; what is shown is old, `
        + 'trying again');
      setTimeout(connect, RETRY);
    };
  }
  setInterval(() => {
    if (socket && socket.readyState === WebSocket.OPEN && performance.now() - lastFrame > SILENCE) {
      connected(false, 'the page\'s program is silent; what is shown is old');
    } else if (socket && socket.readyState === WebSocket.OPEN) {
      connected(true, 'connected');
    }
    changed = true;
    update(performance.now());
  }, 1000);

  async function ask(what) {
    pressedHere = what === 'stop' ? SENDING : '';
    writeStop();
    // for one that hangs a browser waits for minutes
    setTimeout(() => {
      if (what === 'stop' && pressedHere === SENDING) { pressedHere = UNANSWERED; writeStop(); }
    }, PATIENCE);
    try {
      const answer = await fetch(what, { method: 'POST',
        headers: { Authorization: `Bearer ${token}` } });
      if (answer.ok) {
        // of a stop that is pressed again the page hears nothing new
        if (known.stop.pressed) { pressedHere = ''; writeStop(); }
        return;
      }
      pressedHere = `NOT STOPPED by this page: ${(await answer.text()).trim()}`;
      if (answer.status === 403) { token = ''; sessionStorage.removeItem('token'); }
    } catch (error) {
      pressedHere = UNANSWERED;
    }
    if (what !== 'stop') { pressedHere = pressedHere.replace('NOT STOPPED', 'NOT LET GO'); }
    writeStop();
  }
  function keep(given) {
    token = given.trim();
    if (token) { sessionStorage.setItem('token', token); }
    pressedHere = '';
    writeStop();
  }
  element('stop').addEventListener('click', () => ask('stop'));
  element('let-go').addEventListener('click', () => ask('let_go'));
  element('unlock').addEventListener('submit', (event) => {
    event.preventDefault();
    keep(element('token').value);
    element('token').value = '';
    if (token) { element('stop').focus(); }
  });
  element('hold').addEventListener('click', () => {
    held = !held;
    element('hold').setAttribute('aria-pressed', String(held));
  });
  for (const button of document.querySelectorAll('[data-span]')) {
    button.addEventListener('click', () => {
      plots.show(Number(button.dataset.span));
      for (const one of document.querySelectorAll('[data-span]')) {
        one.setAttribute('aria-pressed', String(one === button));
      }
    });
  }
  // a token behind # stays in the browser; it is taken out of the address and its history
  const given = new URLSearchParams(location.hash.slice(1)).get('token');
  if (given) { history.replaceState(null, '', location.pathname); }
  keep(given || sessionStorage.getItem('token') || '');
  connect();
  requestAnimationFrame(drawing);
})();
