# So that mix compiles this application without rebar3; see mix.exs at the top.
defmodule StarlPicture.MixProject do
  use Mix.Project

  {:ok, [{:application, _, props}]} =
    :file.consult(String.to_charlist(Path.join(__DIR__, "src/starl_picture.app.src")))

  @props props

  def project do
    [app: :starl_picture, version: to_string(@props[:vsn]), language: :erlang, deps: deps()]
  end

  def application do
    Keyword.take(@props, [:applications, :description, :env, :mod, :registered])
  end

  defp deps do
    for app <- @props[:applications],
        File.dir?(Path.join(__DIR__, "../#{app}")),
        do: {app, path: "../#{app}"}
  end
end
