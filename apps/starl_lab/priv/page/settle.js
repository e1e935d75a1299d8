// Makes a part of the page what it is to be now, and leaves alone what is the same already: so the focus, the
// selection, what is open and how far it is scrolled stay. Parts in a list are told apart by `data-key`.
export function settle(parent, parts) {
  let next = parent.firstChild;
  const drop = until => {
    while (next !== until) { const gone = next; next = next.nextSibling; gone.remove(); }
  };
  for (const part of parts) {
    let old = next;
    while (old && !isAlike(old, part)) old = old.nextSibling;
    if (old) {
      drop(old);
      next = old.nextSibling;
      renew(old, part);
    } else parent.insertBefore(part, next);
  }
  drop(null);
}

const isAlike = (a, b) => a.nodeName === b.nodeName && a.dataset?.key === b.dataset?.key;

// What the user has opened stays open, and a text that the user has selected waits.
function renew(old, now) {
  if (old.nodeType === Node.TEXT_NODE) {
    if (old.data !== now.data && !isSelected(old)) old.data = now.data;
    return;
  }
  for (const { name } of [...old.attributes])
    if (name !== 'open' && !now.hasAttribute(name)) old.removeAttribute(name);
  for (const { name, value } of now.attributes)
    if (name !== 'open' && old.getAttribute(name) !== value) old.setAttribute(name, value);
  old.onclick = now.onclick;
  settle(old, [...now.childNodes]);
}

function isSelected(text) {
  const selection = getSelection();
  return !selection.isCollapsed && selection.containsNode(text, true);
}
