// Light always; and what gradio's own parts lack for who listens to the page.
() => {
  document.body.classList.remove('dark');
  const named = () => {
    document.querySelectorAll('#upload button[aria-label]').forEach((one) => one.innerText.trim() && one.removeAttribute('aria-label'));
    document.querySelectorAll('.select-all-checkbox:not([aria-label])').forEach((one) => one.setAttribute('aria-label', 'All shots'));
  };
  named();
  new MutationObserver(named).observe(document.body, {childList: true, subtree: true, attributeFilter: ['aria-label']});
}
