// The line to the server. Each message is acknowledged when it has been handled, so the server sends
// no more than the page can take.
export function connect(take, said) {
  let socket = null, tries = 0, left = false;
  const token = location.hash.slice(1);
  const path = '/ws' + (token ? `?token=${encodeURIComponent(token)}` : '');
  // A WebSocket is not told why it was not opened; another request is.
  const refused = () => fetch(path, { method: 'POST' }).then(answer => answer.status === 403, () => false);
  const open = () => {
    socket = new WebSocket(`ws://${location.host}${path}`);
    socket.onopen = () => { tries = 0; said('open'); };
    socket.onmessage = event => {
      take(JSON.parse(event.data));
      if (socket.readyState === 1) socket.send('k');
    };
    socket.onclose = () => {
      if (left) return;
      said('closed');
      refused().then(is => {
        if (is) said('refused');
        else if (tries++ < 5) setTimeout(open, 500 * tries);
      });
    };
  };
  open();
  // A token that is typed later, or better, is another address to the user, and the same one to the browser.
  addEventListener('hashchange', () => location.reload());
  // A page that is left is kept by the browser for a while, with its connection: the run would wait for it.
  addEventListener('pagehide', () => { left = true; socket.close(); });
  addEventListener('pageshow', event => { if (event.persisted) { left = false; open(); } });
  return command => {
    if (socket.readyState === 1) socket.send(JSON.stringify(command));
  };
}
