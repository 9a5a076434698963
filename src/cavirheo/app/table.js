// A click on a column's head sorts the shots; a click on a shot shows its simulation. Enter and Space do the same.
const table = () => element.querySelector('.curves');
const value = (row, k) => {
  const text = (row.cells[k].querySelector('[title]')?.title || row.cells[k].childNodes[0]?.textContent || '').trim();
  return Number.isNaN(parseFloat(text)) ? text : parseFloat(text);
};
const makeFocusable = () => {
  for (const one of element.querySelectorAll('.curves thead th, .curves tbody tr:not(.doubt) td:first-child')) {
    one.tabIndex = 0;
    if (one.tagName === 'TD') one.setAttribute('aria-label', `${one.innerText}: show its simulation`);
  }
};
const order = (head) => {
  const k = head.cellIndex, body = table().tBodies[0];
  const sign = head.getAttribute('aria-sort') === 'ascending' ? -1 : 1;
  const rows = [...body.rows].filter((row) => !row.classList.contains('doubt'));
  const below = new Map(rows.map((row) => [row, row.nextElementSibling?.matches('.doubt') ? row.nextElementSibling : null]));
  for (const one of table().tHead.rows[0].cells) one.removeAttribute('aria-sort');
  head.setAttribute('aria-sort', sign > 0 ? 'ascending' : 'descending');
  const before = (a, b) => (typeof a === 'number' && typeof b === 'number' ? a - b
    : String(a).localeCompare(String(b), undefined, {numeric: true}));
  rows.sort((a, b) => sign * before(value(a, k), value(b, k)));
  for (const row of rows) body.append(row, ...(below.get(row) ? [below.get(row)] : []));
};
const act = (event) => {
  const head = event.target.closest('.curves thead th'), row = event.target.closest('.curves tbody tr:not(.doubt)');
  if (head) return order(head);
  if (!row || element.querySelector('.stale, .busy')) return;
  document.body.dataset.picked = row.cells[0].querySelector('[title]')?.title || row.cells[0].childNodes[0].textContent;
  trigger('click');
};
element.addEventListener('click', act);
element.addEventListener('keydown', (event) => {
  if (event.key === 'Enter' || event.key === ' ') { if (event.target.tabIndex === 0 && event.target.closest('.curves')) event.preventDefault(); act(event); }
});
watch('value', makeFocusable);
