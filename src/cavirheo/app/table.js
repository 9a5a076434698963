// A click on a shot shows its simulation, and so do Enter and Space; heads of columns sort the shots (the report's table.js).
const makeFocusable = () => {
  for (const one of element.querySelectorAll('.curves thead th, .curves tbody tr:not(.doubt) td:first-child')) {
    one.tabIndex = 0;
    if (one.tagName === 'TD') one.setAttribute('aria-label', `${one.innerText}: show its simulation`);
  }
};
const pick = (event) => {
  const row = event.target.closest('.curves tbody tr:not(.doubt)');
  if (!row || element.querySelector('.busy')) return;
  document.body.dataset.picked = row.cells[0].querySelector('[title]')?.title || row.cells[0].childNodes[0].textContent;
  trigger('click');
};
element.addEventListener('click', pick);
element.addEventListener('keydown', (event) => {
  if (event.key !== 'Enter' && event.key !== ' ') return;
  if (event.target.tabIndex === 0 && event.target.closest('.curves')) event.preventDefault();
  pick(event);
});
watch('value', makeFocusable);
