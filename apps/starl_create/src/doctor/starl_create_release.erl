%% @doc Starts a Create 2 anew, which prints its release among the first bytes.
-module(starl_create_release).

-export([read/1]).

-define(BANNER_MS, 6000).

%% @doc The name of its release.
-spec read(starl_create_probe:t()) -> binary() | string().
read(Probe) ->
    _ = starl_create_probe:listen(Probe, 30),
    ok = starl_create_probe:send(Probe, <<7>>),
    Banner = banner(Probe, <<>>, ?BANNER_MS div 100),
    ok = starl_create_probe:send(Probe, <<128>>),
    release(Banner).

banner(_Probe, Bytes, 0) ->
    Bytes;
banner(Probe, Bytes, N) ->
    Now = <<Bytes/binary, (starl_create_probe:listen(Probe, 100))/binary>>,
    case re:run(Now, "release-[^\r\n]*\r?\n", [{capture, none}]) of
        match -> Now;
        nomatch -> banner(Probe, Now, N - 1)
    end.

release(Banner) ->
    case re:run(Banner, "release-([-.a-z0-9]*)", [{capture, all_but_first, binary}]) of
        {match, [Release]} when is_binary(Release) -> Release;
        nomatch -> "it does not tell its release after a reset"
    end.
