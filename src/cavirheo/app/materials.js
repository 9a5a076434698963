// Materials typed in the table of shots. A name typed at a file's first shot holds for all its shots that had the same.
element.addEventListener('change', ({target}) => {
  const boxes = [...element.querySelectorAll('.shots input[data-file]')];
  const before = target.dataset.previous ?? target.defaultValue;
  const same = boxes.filter((one) => one.dataset.file === target.dataset.file);
  for (const one of same[0] === target ? same : []) {
    if ((one.dataset.previous ?? one.defaultValue) === before) one.value = target.value;
  }
  for (const one of boxes) one.dataset.previous = one.value;
  document.body.dataset.materials = JSON.stringify(boxes.map((one) => one.value));
  trigger('submit');
});
