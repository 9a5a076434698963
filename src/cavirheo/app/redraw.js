// The sliders change two lines of a figure that is there already: nothing measured is sent again. Moving the lines alone
// takes half the time of a restyle, which is needed where they are new or leave the axes. The numbers travel as one
// string, for the page's own state copies lists element by element, which takes longer than all else.
watch('value', async () => {
  const plot = document.querySelector('#check-plot .js-plotly-plot');
  const lines_of = (props.value || {}).lines;
  if (!plot || !window.Plotly || !lines_of) return;
  const {x, y, traces} = JSON.parse(lines_of);
  const within = (values, range) => values.every((v) => v >= range[0] && v <= range[1]);
  if (plot.data[traces[0]].x.length && x[0].length && within(y[0], plot.layout.yaxis.range)
      && within(y[1], plot.layout.yaxis2.range)) {
    const lines = {data: x.map((_, k) => ({x: x[k], y: y[k]})), traces};
    await window.Plotly.animate(
      plot, lines, {transition: {duration: 0}, frame: {duration: 0, redraw: false}, mode: 'immediate'});
  } else {
    await window.Plotly.restyle(plot, {x, y}, traces);
  }
  document.body.dataset.redrawn = String(Number(document.body.dataset.redrawn || 0) + 1);
});
