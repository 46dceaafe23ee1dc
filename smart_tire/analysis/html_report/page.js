'use strict';
(() => {
  const LIGHT = {
    ink: '#1c2733', shade: '#7a8793', grid: '#e3e7eb', paper: '#ffffff',
    blue: '#0072b2', vermillion: '#d55e00', orange: '#e69f00', sky: '#56b4e9',
    green: '#009e73', purple: '#cc79a7',
  };
  const DARK = {
    ...LIGHT, ink: '#e6eaee', shade: '#8794a1', grid: '#2b343e', paper: '#14191f',
    blue: '#4aa8e0', vermillion: '#f0803c',
  };
  const BAND_OPACITY = 0.22;
  const CONFIG = {
    displaylogo: false, responsive: true, modeBarButtons: [[
      'toImage', 'zoom2d', 'pan2d', 'zoomIn2d', 'zoomOut2d', 'autoScale2d', 'resetScale2d']],
    toImageButtonOptions: {scale: 2},
  };
  const PRINT_WIDTH = 680;  // px, of A4 and letter paper
  const plots = [...document.querySelectorAll('.plot')];
  const timed = plots.filter((plot) => plot.dataset.time !== undefined);
  const whole = JSON.parse(document.body.dataset.range);
  const dark = window.matchMedia('(prefers-color-scheme: dark)');
  let linking = false;

  function band(color) {
    const parts = [1, 3, 5].map((start) => parseInt(color.slice(start, start + 2), 16));
    return `rgba(${parts.join(', ')}, ${BAND_OPACITY})`;
  }

  // The specification of a plot, with the colors of the theme for names such as "@blue", those of
  // bands for names such as "@blue_band".
  function specification(plot, theme) {
    const text = document.getElementById(plot.dataset.spec).textContent;
    return JSON.parse(text.replace(/"@([a-z]+)(_band)?"/g, (name, color, suffix) => (
      color in theme ? JSON.stringify(suffix ? band(theme[color]) : theme[color]) : name)));
  }

  function theme() {
    return dark.matches ? DARK : LIGHT;
  }

  // Show the time range [s] in all plots over time.
  async function show(range, except) {
    linking = true;
    try {
      await Promise.all(timed.filter((plot) => plot !== except).map(
        (plot) => Plotly.relayout(plot, {'xaxis.range': [...range]})));
    } finally {
      linking = false;
    }
  }

  function link(plot) {
    plot.on('plotly_relayout', (change) => {
      if (linking) {
        return;
      }
      const keys = Object.keys(change);
      const first = keys.find((key) => /^xaxis\d*\.range\[0\]$/.test(key));
      if (first !== undefined) {
        show([change[first], change[first.replace('[0]', '[1]')]], plot);
      } else if (keys.some((key) => /^xaxis\d*\.(autorange|range)$/.test(key))) {
        const range = keys.some((key) => /autorange$/.test(key)) ? whole : plot.layout.xaxis.range;
        show(range);
      }
    });
  }

  async function restyle(colors, changes) {
    for (const plot of plots) {
      const {data, layout} = specification(plot, colors);
      if (plot.layout.xaxis.range && timed.includes(plot)) {
        layout.xaxis.range = [...plot.layout.xaxis.range];
      }
      await Plotly.react(plot, data, {...layout, ...changes}, CONFIG);
    }
  }

  async function draw() {
    for (const plot of plots) {
      const {data, layout} = specification(plot, theme());
      await Plotly.newPlot(plot, data, layout, CONFIG);
      await new Promise((done) => setTimeout(done, 0));  // keeps the page responsive
    }
    timed.forEach(link);
    document.body.dataset.plots = plots.length;
  }

  window.addEventListener('error', (event) => {
    const text = document.createElement('p');
    text.className = 'error';
    text.textContent = `The plots cannot be drawn: ${event.message}`;
    document.querySelector('main').prepend(text);
  });
  document.querySelectorAll('button[data-range]').forEach((button) => button.addEventListener(
    'click', () => show(JSON.parse(button.dataset.range))));
  dark.addEventListener('change', () => restyle(theme(), {}));
  window.addEventListener('beforeprint', () => restyle(LIGHT, {autosize: false,
                                                               width: PRINT_WIDTH}));
  window.addEventListener('afterprint', () => restyle(theme(), {autosize: true}));
  draw().catch((error) => window.dispatchEvent(new ErrorEvent('error', {message: String(error)})));
})();
