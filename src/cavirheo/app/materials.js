// What is typed in the table of files are the materials of its shots; the first shot of a file names all that were as it.
const was = (box) => box.dataset.was ?? box.defaultValue;
element.addEventListener('change', ({target}) => {
  const boxes = [...element.querySelectorAll('.found input')];
  const mine = boxes.filter((one) => one.dataset.file === target.dataset.file), before = was(target);
  for (const one of mine[0] === target ? mine : []) if (was(one) === before) one.value = target.value;
  for (const one of boxes) one.dataset.was = one.value;
  document.body.dataset.materials = JSON.stringify(boxes.map((one) => one.value));
  trigger('submit');
});
